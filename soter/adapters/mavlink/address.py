"""Connection strings: `udpin:127.0.0.1:14550`, `udpout:HOST:PORT`, `tcp:HOST:PORT`, `serial:/dev/ttyACM0:57600`."""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass
from typing import Final

_KINDS: Final = ("udpin", "udpout", "tcp", "serial")
_FORMS: Final = "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or serial:DEVICE:BAUD"


@dataclass(frozen=True, slots=True)
class Address:
    """Where vehicles are reached.

    Attributes:
        kind: "udpin" (they send to us), "udpout" (we send to them first), "tcp" (they listen) or "serial".
        host: a name or address; for "serial" the device.
        port: the port; for "serial" the baud rate.
    """

    kind: str
    host: str
    port: int

    @staticmethod
    def parse(text: str) -> Address:
        """Read a connection string; `udpin://HOST:PORT`, as MAVSDK writes it, means the same.

        Raises:
            ValueError: it is none; the message says what is allowed.
        """
        kind, _, rest = text.partition(":")
        host, _, number = rest.removeprefix("//").rpartition(":")
        if kind not in _KINDS or not host:
            raise ValueError(f"'{text}' is no connection, allowed: {_FORMS}")
        most = 4_000_000 if kind == "serial" else 65535
        if not (number.isascii() and number.isdecimal() and 1 <= int(number) <= most):
            what = "baud rate" if kind == "serial" else "port"
            raise ValueError(f"'{text}' has the {what} '{number}', allowed: 1 to {most}")
        return Address(kind, host, int(number))

    @property
    def is_local(self) -> bool:
        """Whether nobody but this host, or who holds the cable, can send on it."""
        if self.kind == "serial" or self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False

    def __str__(self) -> str:
        return f"{self.kind}:{self.host}:{self.port}"

    @property
    def mavsdk_url(self) -> str:
        """The same for MAVSDK."""
        kind = "tcpout" if self.kind == "tcp" else self.kind
        return f"{kind}://{self.host}:{self.port}"
