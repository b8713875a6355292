"""Robots on Zenoh behind mutual TLS, for the kit: `soter conform tests.adapters.zenoh.tls_harness:TlsHarness`."""

from __future__ import annotations

import tempfile
from pathlib import Path

from soter.adapters.zenoh.harness import ZenohHarness, ZenohRelay
from soter.adapters.zenoh.session import SessionOptions, endpoints
from tests.adapters.zenoh.sessions import Authority


class TlsHarness(ZenohHarness):
    """Every link is encrypted, and nobody has one without a certificate of the authority that all believe."""

    name = "zenoh, mutual TLS"

    def __init__(self) -> None:
        super().__init__()
        self._folder = tempfile.TemporaryDirectory(prefix="soter-tls-")
        self._tls = Authority(Path(self._folder.name) / "authority").tls("127.0.0.1")
        assert self._tls.mutual

    def of_robots(self) -> SessionOptions:
        return SessionOptions(tls=self._tls)

    def of_relay(self) -> SessionOptions:
        return SessionOptions(tls=self._tls)

    def to_relay(self, relay: ZenohRelay) -> SessionOptions:
        return SessionOptions(tls=self._tls, connect=tuple(endpoints(relay.session)))
