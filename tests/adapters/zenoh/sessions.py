"""Sessions of tests: closed at their end, and waited for with a limit."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Final

import trustme
import zenoh

from soter.adapters.zenoh.session import SessionOptions, TlsOptions, close_session, endpoints, open_session
from tests.waiting import eventually

SILENCE_S: Final = 0.3
"""How long nothing must come where nothing may come."""


@contextmanager
def opened(*several: SessionOptions) -> Iterator[list[zenoh.Session]]:
    with ExitStack() as stack:
        sessions = []
        for each in several:
            sessions.append(open_session(each))
            stack.callback(close_session, sessions[-1])
        yield sessions


@contextmanager
def router(**options: Any) -> Iterator[list[str]]:
    """A router in this process; yields where it listens."""
    options = {"listen": ["tcp/127.0.0.1:0"]} | options
    with opened(SessionOptions(mode="router", **options)) as (session,):
        yield endpoints(session)


def client(where: list[str], **options: Any) -> SessionOptions:
    return SessionOptions(mode="client", connect=tuple(where), **options)


class Heard(list[bytes]):
    """What has come under a key so far."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        super().__init__()
        session.declare_subscriber(key, lambda sample: self.append(sample.payload.to_bytes()))

    def hears(self, speaker: zenoh.Session, key: str) -> bool:
        """Whether what a session says comes, said again and again until then."""

        def said_and_heard() -> bool:
            speaker.put(key, b"heard?")
            return b"heard?" in self

        return eventually(said_and_heard)


class Authority:
    """Certificates of an authority of its own.

    Args:
        folder: where they are written to.
    """

    def __init__(self, folder: Path) -> None:
        folder.mkdir()
        self._folder = folder
        self._authority = trustme.CA(key_type=trustme.KeyType.ECDSA)
        self.root = folder / "root.pem"
        self._authority.cert_pem.write_to_path(self.root)

    def tls(self, name: str | None = None, *, root: Path | None = None, **options: Any) -> TlsOptions:
        """TLS by these certificates.

        Args:
            name: the host in a certificate of one's own; None for nobody's.
            root: who is believed; None: this authority.
            options: further ones of `TlsOptions`.
        """
        if name is None:
            return TlsOptions(root_ca=root or self.root, mutual=False, **options)
        certificate, key = self._folder / f"{name}.pem", self._folder / f"{name}.key"
        issued = self._authority.issue_cert(name, key_type=trustme.KeyType.ECDSA)
        certificate.write_bytes(b"".join(each.bytes() for each in issued.cert_chain_pems))
        issued.private_key_pem.write_to_path(key)
        return TlsOptions(root_ca=root or self.root, certificate=certificate, private_key=key, **options)
