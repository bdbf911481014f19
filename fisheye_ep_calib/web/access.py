"""Who may look and who may act: names that are ours, pages that are ours, and beyond this machine a token."""

from __future__ import annotations

import ipaddress
import secrets
import socket
from urllib.parse import urlsplit

COOKIE = "fisheye_ep_calib"


class Access:
    """The rules of one server. token: what others than this machine must show; empty where only it can reach us."""

    def __init__(self, local: bool) -> None:
        self._local = local
        self.token = "" if local else secrets.token_urlsafe(18)

    def is_our_name(self, host: str) -> bool:
        """Whether a Host header names this machine as no foreign domain can that was pointed at it (DNS rebinding)."""
        try:
            name = urlsplit(f"//{host}").hostname or ""
        except ValueError:
            return False
        if self._local:
            return name == "localhost" or _is_loopback(name)
        own = socket.gethostname().lower()
        return name in ("localhost", own, f"{own}.local", socket.getfqdn().lower()) or _is_address(name)

    def is_our_page(self, origin: str, host: str) -> bool:
        """Whether a request that acts came from the page itself: its Origin is the Host that it was sent to."""
        return bool(host) and origin == f"http://{host}"

    def knows(self, shown: str) -> bool:
        """Whether a token that was shown is the one."""
        return not self.token or secrets.compare_digest(shown.encode("utf-8", "replace"), self.token.encode())


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _is_loopback(name: str) -> bool:
    return _is_address(name) and ipaddress.ip_address(name).is_loopback
