"""Where a Zenoh session listens or connects to: `tcp/HOST:PORT` or `tls/HOST:PORT`."""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass
from typing import Final

PROTOCOLS: Final = ("tcp", "tls")
# Zenoh has more, and settings behind `?` and `#`. Those of UDP open a socket on all interfaces even to connect.
_FORMS: Final = "tcp/HOST:PORT or tls/HOST:PORT"


@dataclass(frozen=True, slots=True)
class Endpoint:
    """One side of a link.

    Attributes:
        protocol: "tcp" or "tls".
        host: a name or an address; one of IPv6 without brackets.
        port: 0 is any free one.
    """

    protocol: str
    host: str
    port: int

    @staticmethod
    def parse(text: str) -> Endpoint:
        """Read an endpoint as Zenoh writes it, such as `tcp/127.0.0.1:7447` or `tls/[::1]:7447`.

        Raises:
            ValueError: it is none, or one that is not allowed here; the message says what is allowed.
        """
        protocol, slash, rest = text.partition("/")
        host, colon, number = rest.rpartition(":")
        if protocol not in PROTOCOLS or not slash or not colon:
            raise ValueError(_FORMS)
        bracketed = host.startswith("[") and host.endswith("]")
        host = host[1:-1] if bracketed else host
        if not host or bracketed != (":" in host) or not host.isascii() or set(host) & set("/?#;[] "):
            raise ValueError(f"{_FORMS}, HOST being a name, an IPv4 address or an IPv6 address in brackets")
        if not (number.isascii() and number.isdecimal() and len(number) <= 5 and int(number) <= 65535):
            raise ValueError(f"{_FORMS}, PORT being 0 to 65535")
        return Endpoint(protocol, host, int(number))

    def __str__(self) -> str:
        return f"{self.protocol}/{f'[{self.host}]' if ':' in self.host else self.host}:{self.port}"

    @property
    def address(self) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
        """Its address, an IPv4 address where it is one in the dress of IPv6; None where it has a name."""
        try:
            found = ipaddress.ip_address(self.host)
        except ValueError:
            return None
        mapped = found.ipv4_mapped if isinstance(found, ipaddress.IPv6Address) else None
        return mapped or found

    @property
    def is_local(self) -> bool:
        """Whether nobody beyond this host has to do with it."""
        return self.host == "localhost" or (self.address is not None and self.address.is_loopback)
