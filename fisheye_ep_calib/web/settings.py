"""Where the page is served."""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass


@dataclass(frozen=True)
class WebSettings:
    """address: to listen at. port: the next free one where it is taken; 0: any."""

    address: str = "127.0.0.1"
    port: int = 8123

    @property
    def local(self) -> bool:
        """Whether only this machine can reach the address."""
        if self.address == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.address).is_loopback
        except ValueError:
            return False
