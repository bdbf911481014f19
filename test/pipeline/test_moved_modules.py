"""Modules that have moved are found under their former names, with a warning."""

from __future__ import annotations

import importlib
import sys
import warnings

import pytest

from fisheye_ep_calib.moved_modules import moved_modules


@pytest.mark.parametrize("former", sorted(moved_modules()))
def test_a_former_name_is_the_module_of_today(former):
    sys.modules.pop(former, None)
    with pytest.warns(DeprecationWarning, match=f"{former} is {moved_modules()[former]} now"):
        found = importlib.import_module(former)
    assert found is importlib.import_module(moved_modules()[former])
    assert found.__name__ == moved_modules()[former] == found.__spec__.name


def test_no_module_of_today_has_a_former_name():
    for former in moved_modules():
        assert importlib.machinery.PathFinder.find_spec(former, sys.modules[former.rpartition(".")[0]].__path__) is None


def test_other_names_are_not_found_and_say_nothing():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(ModuleNotFoundError):
            importlib.import_module("fisheye_ep_calib.calibration.no_such_module")
