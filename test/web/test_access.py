"""Who may look and who may act."""

from __future__ import annotations

import socket

import pytest

from fisheye_ep_calib.web.access import Access
from fisheye_ep_calib.web.settings import WebSettings


@pytest.mark.parametrize("host", ["localhost:8123", "127.0.0.1:8123", "[::1]:8123", "localhost", "127.8.8.8"])
def test_this_machine_has_these_names(host: str) -> None:
    assert Access(local=True).is_our_name(host) and Access(local=False).is_our_name(host)


@pytest.mark.parametrize(
    "host", ["evil.example:8123", "localhost.evil.example", "127.0.0.1.evil.example", "", "[", "10.0.0.5:8123", "a b"]
)
def test_a_foreign_name_that_was_pointed_here_is_refused(host: str) -> None:
    assert not Access(local=True).is_our_name(host)


def test_beyond_this_machine_its_name_and_addresses_are_ours() -> None:
    access = Access(local=False)
    assert access.is_our_name("10.0.0.5:8123") and access.is_our_name(f"{socket.gethostname()}:8123")
    assert not access.is_our_name("evil.example:8123")


def test_only_the_page_itself_acts() -> None:
    access = Access(local=True)
    assert access.is_our_page("http://localhost:8123", "localhost:8123")
    for origin in ("", "null", "http://evil.example", "http://localhost:9000", "https://localhost:8123"):
        assert not access.is_our_page(origin, "localhost:8123")
    assert not access.is_our_page("http://", "")


def test_the_token_is_asked_for_beyond_this_machine_only() -> None:
    far = Access(local=False)
    assert far.knows(far.token) and len(far.token) >= 20
    assert not far.knows("") and not far.knows("ä") and not far.knows(far.token[:-1])
    assert far.token != Access(local=False).token
    assert Access(local=True).knows("")


@pytest.mark.parametrize(
    ("address", "local"),
    [("127.0.0.1", True), ("::1", True), ("localhost", True), ("0.0.0.0", False), ("::", False), ("robot", False)],
)
def test_what_only_this_machine_reaches(address: str, local: bool) -> None:
    assert WebSettings(address).local == local
