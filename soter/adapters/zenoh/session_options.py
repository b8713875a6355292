"""Options of a Zenoh session: endpoints, encryption, passwords."""

from __future__ import annotations

import ipaddress
import os
import re
import ssl
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import BaseModel, Field, ValidationInfo, field_validator

from soter.errors import ConfigError
from soter.problems import not_allowed

PROTOCOLS: Final = ("tcp", "tls")
# Zenoh has more protocols, and settings behind `?` and `#`. UDP opens a socket on all interfaces even to connect.
_FORMS: Final = "tcp/HOST:PORT or tls/HOST:PORT"


@dataclass(frozen=True, slots=True)
class Endpoint:
    """An endpoint to listen at or connect to: `tcp/HOST:PORT` or `tls/HOST:PORT`.

    Attributes:
        protocol: "tcp" or "tls".
        host: a name or an address; an IPv6 address without brackets.
        port: 0 for any free port.
    """

    protocol: str
    host: str
    port: int

    @staticmethod
    def parse(text: str) -> Endpoint:
        """Return the endpoint in a text in Zenoh's form, such as `tcp/127.0.0.1:7447` or `tls/[::1]:7447`.

        Raises:
            ValueError: the text is no endpoint that is allowed here; the message says what is allowed.
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
        """The host's address, an IPv4-mapped IPv6 address as IPv4; None if the host is a name."""
        try:
            found = ipaddress.ip_address(self.host)
        except ValueError:
            return None
        mapped = found.ipv4_mapped if isinstance(found, ipaddress.IPv6Address) else None
        return mapped or found

    @property
    def is_local(self) -> bool:
        """Whether the endpoint is on this host."""
        return self.host == "localhost" or (self.address is not None and self.address.is_loopback)


DEFAULT_PORT: Final = 7447
"""A router's default port, as with Zenoh in general."""


def _readable(path: Path) -> Path:
    try:
        with path.open("rb"):
            return path
    except OSError as failure:
        raise not_allowed(f"a file that can be read ({failure.strerror or failure})") from failure


class TlsOptions(BaseModel, extra="forbid", frozen=True):
    """Encryption of links, and the certificates that it needs.

    Attributes:
        root_ca: the certificates of the only trusted authorities, in PEM.
        certificate: this session's own certificate, in PEM, for both ends of links.
        private_key: the certificate's private key, in PEM, without a passphrase.
        mutual: whether sessions that connect to this one must show a certificate too.
        verify_name: whether the certificate of a host that is connected to must name the host.
    """

    root_ca: Path
    certificate: Path | None = None
    private_key: Path | None = Field(default=None, validate_default=True)
    mutual: bool = Field(default=True, validate_default=True)
    verify_name: bool = True

    @field_validator("root_ca")
    @classmethod
    def _is_authority(cls, path: Path) -> Path:
        try:
            ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT).load_verify_locations(_readable(path))
        except ssl.SSLError as failure:
            raise not_allowed(f"certificates in PEM ({failure.reason or 'it has none'})") from failure
        return path

    @field_validator("certificate")
    @classmethod
    def _is_there(cls, path: Path | None) -> Path | None:
        return None if path is None else _readable(path)

    @field_validator("private_key")
    @classmethod
    def _belongs(cls, path: Path | None, info: ValidationInfo) -> Path | None:
        if "certificate" not in info.data:
            return path
        certificate = info.data["certificate"]
        if path is None and certificate is None:
            return None
        if path is None:
            raise not_allowed("the private key of the certificate")
        if certificate is None:
            raise not_allowed("none without a certificate")
        try:
            # An empty passphrase, so that OpenSSL does not ask for one on the terminal.
            ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, _readable(path), password="")
        except (ssl.SSLError, ValueError) as failure:
            reason = getattr(failure, "reason", None) or "it does not belong to it"
            raise not_allowed(
                f"the private key of certificate '{certificate}', both in PEM, without a passphrase ({reason})"
            ) from failure
        return path

    @field_validator("mutual")
    @classmethod
    def _can_show(cls, mutual: bool, info: ValidationInfo) -> bool:
        if mutual and "certificate" in info.data and info.data["certificate"] is None:
            raise not_allowed("false without a certificate, or true with one")
        return mutual


class SessionOptions(BaseModel, extra="forbid", frozen=True):
    """Options of a session.

    Attributes:
        mode: a "peer" talks with peers that it has a link to; a "client" talks through a router; a "router" passes
            messages on between its clients, but not between peers.
        tls: encrypts all links; without it no link is encrypted.
        unencrypted: whether links that leave this host may be unencrypted, for a network that is closed itself.
        allow_all_interfaces: whether the session may listen on 0.0.0.0 and [::].
        listen: endpoints to listen at. Default for a peer: any port of 127.0.0.1, but none with TLS and without a
            certificate of its own; for a router: port 7447 of 127.0.0.1.
        connect: endpoints to connect to. A client needs one, and connects to the first that answers; others to all.
        username: this session's name at the endpoints that it connects to.
        password_file: a file whose first line is the password.
        password_env: an environment variable with the password, instead of a file.
        users_file: who may connect, one `NAME:PASSWORD` per line; without it no names are required.
        open_timeout_s: how long a client waits for its first router, and any session for a link.
        lease_s: time of silence after which a link is given up and made anew.
    """

    mode: Literal["peer", "client", "router"] = "peer"
    tls: TlsOptions | None = None
    unencrypted: bool = False
    allow_all_interfaces: bool = False
    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = Field(default=(), validate_default=True)
    username: str | None = None
    password_file: Path | None = None
    password_env: str | None = Field(default=None, validate_default=True)
    users_file: Path | None = None
    open_timeout_s: Annotated[float, Field(ge=0.1, le=60.0, allow_inf_nan=False)] = 5.0
    lease_s: Annotated[float, Field(ge=0.5, le=60.0, allow_inf_nan=False)] = 3.0

    @field_validator("listen", "connect")
    @classmethod
    def _are_endpoints(cls, texts: tuple[str, ...], info: ValidationInfo) -> tuple[str, ...]:
        listens, mode = info.field_name == "listen", info.data.get("mode")
        if listens and texts and mode == "client":
            raise not_allowed("none with mode = 'client'; only peers and routers listen")
        if not listens and not texts and mode == "client":
            raise not_allowed("at least one with mode = 'client', such as 'tcp/127.0.0.1:7447'")
        for text in texts:
            try:
                endpoint = Endpoint.parse(text)
            except ValueError as failure:
                raise not_allowed(f"{failure}; '{text}' is none") from failure
            why = _not_encrypted(endpoint, info.data) or (
                _not_to_listen_on(endpoint, info.data) if listens else _not_to_connect_to(endpoint)
            )
            if why:
                raise not_allowed(f"{why}; '{text}' is not")
        return texts

    @field_validator("username")
    @classmethod
    def _is_a_name(cls, name: str | None) -> str | None:
        if name is not None and not re.fullmatch(r"[^:\s]{1,64}", name):
            raise not_allowed("1 to 64 characters without spaces and colons")
        return name

    @field_validator("password_env")
    @classmethod
    def _has_one_password(cls, variable: str | None, info: ValidationInfo) -> str | None:
        if not {"username", "password_file"} <= info.data.keys():
            return variable
        given = (variable is not None) + (info.data["password_file"] is not None)
        if info.data["username"] is None and given:
            raise not_allowed("a password only with a username")
        if info.data["username"] is not None and given != 1:
            raise not_allowed("with a username one of password_file and password_env")
        return variable

    @field_validator("users_file")
    @classmethod
    def _lists_users(cls, path: Path | None) -> Path | None:
        if path is None:
            return None
        try:
            lines = _readable(path).read_text(encoding="utf-8").splitlines()
        except UnicodeDecodeError as failure:
            raise not_allowed("a text file, NAME:PASSWORD a line") from failure
        wrong = next((number for number, line in enumerate(lines, 1) if not re.fullmatch(r"[^:\s]+:\S+", line)), None)
        if wrong is not None or not lines:
            # The message does not quote the line, which may hold a password.
            raise not_allowed("NAME:PASSWORD a line; " + ("there is none" if not lines else f"line {wrong} is none"))
        return path

    def read_password(self) -> str | None:
        """Return the password, or None without a username.

        Raises:
            ConfigError: the password is missing.
        """
        if self.username is None:
            return None
        if self.password_env is not None:
            password, key = os.environ.get(self.password_env, ""), "password_env"
            where = f"the environment variable '{self.password_env}'"
        else:
            assert self.password_file is not None
            key, where = "password_file", f"the first line of '{self.password_file}'"
            try:
                password = self.password_file.read_text(encoding="utf-8").partition("\n")[0]
            except (OSError, UnicodeDecodeError) as failure:
                raise ConfigError(f"{where} cannot be read: {failure}", key=key) from failure
        if not re.fullmatch(r"\S+", password.strip()):
            raise ConfigError(f"there is no password in {where}, allowed: a text without spaces", key=key)
        return password.strip()

    @property
    def listens_at(self) -> tuple[str, ...]:
        """The endpoints to listen at: the given ones, or the default."""
        if self.listen or self.mode == "client":
            return self.listen
        if self.tls is not None and self.tls.certificate is None:
            return ()
        protocol = "tcp" if self.tls is None else "tls"
        return (f"{protocol}/127.0.0.1:{DEFAULT_PORT if self.mode == 'router' else 0}",)


def _not_encrypted(endpoint: Endpoint, given: dict[str, Any]) -> str | None:
    """Return what is allowed instead of an endpoint that lacks encryption, or cannot have it; None if it is allowed."""
    if "tls" not in given:
        return None
    if endpoint.protocol == "tls":
        return None if given["tls"] is not None else "tls/… with a table 'tls' that names root_ca"
    if given["tls"] is not None:
        return "tls/… where there is a table 'tls'"
    if endpoint.is_local or given.get("unencrypted", True):
        return None
    return "127.0.0.1, or tls/… with a table 'tls', or unencrypted = true where the network itself is closed"


def _not_to_listen_on(endpoint: Endpoint, given: dict[str, Any]) -> str | None:
    address = endpoint.address
    if address is None and endpoint.host != "localhost":
        # Names such as "0" stand for all interfaces too.
        return "an address of this host, such as 127.0.0.1"
    if address is not None and address.is_multicast:
        return "an address of this host, and no multicast"
    if address is not None and address.is_unspecified and not given.get("allow_all_interfaces", True):
        return "an address of this host, such as 127.0.0.1, or allow_all_interfaces = true"
    tls = given.get("tls")
    if endpoint.protocol == "tls" and tls is not None and tls.certificate is None:
        return "tls/… with tls.certificate and tls.private_key"
    return None


def _not_to_connect_to(endpoint: Endpoint) -> str | None:
    address = endpoint.address
    if endpoint.port == 0 or (address is not None and (address.is_multicast or address.is_unspecified)):
        return "HOST:PORT where somebody listens"
    return None
