"""calibration.json is as docs/calibration.schema.json says."""

from __future__ import annotations

import copy
import json
from pathlib import Path

import jsonschema
import pytest
from command_line import strict_json

from fisheye_ep_calib.storage.observation_file import load_observations, save_observations

SCHEMA = json.loads((Path(__file__).resolve().parents[2] / "docs" / "calibration.schema.json").read_text("utf-8"))


def check_record(record: dict) -> None:
    """Raises jsonschema.ValidationError where it is not as docs/calibration.schema.json says."""
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    jsonschema.Draft202012Validator(SCHEMA).validate(record)


def record_of(folder: Path) -> dict:
    return strict_json((folder / "calibration.json").read_text("utf-8"))


@pytest.mark.parametrize("model", ["auto", "ep_odd", "kannala", "ep_odd_target_axis"])
def test_the_record_of_observation_files_is_as_its_schema_says(command, observation_file, tmp_path, model) -> None:
    save_observations(tmp_path / "poor.npz", load_observations(observation_file).select_images([0, 1]))
    assert command("calibrate", observation_file, "poor.npz", "--model", model, "--output", "out").code == 1
    record = record_of(tmp_path / "out")
    check_record(record)
    assert record["cameras"]["front"].keys() == SCHEMA["$defs"]["camera"]["properties"].keys()
    assert record["failed"].keys() == {"poor"} and record["options"]["svp_distance"] == "inf"


def test_the_record_of_images_is_as_its_schema_says(command, recording, tmp_path) -> None:
    words = ("--topic", "front=/left/image_raw", "--topic", "rear=/right/image_raw", "--workers", 1, "--no-report")
    assert command(
        "calibrate", recording / "rig.mcap", "--target", recording / "board.yaml", *words, "--output", "out"
    ).code == 0  # fmt: skip
    record = record_of(tmp_path / "out")
    check_record(record)
    assert record["cameras"].keys() == {"front", "rear"}
    assert record["cameras"]["front"]["inputs"].keys() == SCHEMA["$defs"]["inputs"]["properties"].keys()


@pytest.mark.parametrize(
    "damage",
    [
        lambda record: record.update(schema=2),
        lambda record: record.pop("failed"),
        lambda record: record["cameras"]["front"].pop("rms_px"),
        lambda record: record["cameras"]["front"].update(rms_px="0.1"),
        lambda record: record["cameras"]["front"].update(views=1.5),
        lambda record: record["cameras"]["front"].update(converged=1),
        lambda record: record["cameras"]["front"]["svp_loss_px"].update({"0.1": "far"}),
        lambda record: record["cameras"]["front"]["per_view"][0].update(distance_m="0.3"),
        lambda record: record["cameras"]["front"]["inputs"].pop("source"),
    ],
)
def test_the_schema_refuses_a_wrong_record_and_takes_more_fields(camera_file, damage) -> None:
    record = record_of(camera_file.parent)
    more = copy.deepcopy(record)
    more["more"] = more["cameras"]["front"]["more"] = more["cameras"]["front"]["per_view"][0]["more"] = "later"
    more["cameras"]["front"]["svp_loss_px"] |= {"0.1": None, "inf": "inf"}
    check_record(more)
    damage(record)
    with pytest.raises(jsonschema.ValidationError):
        check_record(record)
