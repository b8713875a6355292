"""What listens beyond this host is found, and named."""

from __future__ import annotations

import socket
import sys

import pytest

from soter.conformance import CLAUSES, Verdict, try_clause, usage
from soter.conformance.clauses import surroundings
from soter.conformance.usage import listening
from tests.conformance.wire import WireHarness, WireRobot


def test_what_this_process_listens_at_is_seen_with_its_address_while_it_does() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        at = server.getsockname()
        assert at in (listening() or {})
    assert at not in (listening() or {})


def test_addresses_of_ipv6_are_read_as_the_kernel_shows_them() -> None:
    shown = "".join(f"{int.from_bytes(b, sys.byteorder):08X}" for b in (bytes(4), bytes(4), bytes(4), b"\0\0\0\1"))
    assert usage._address(socket.AF_INET6, shown) == "::1"


@pytest.mark.parametrize(
    ("address", "verdict"),
    [("127.0.0.1", Verdict.PASS), ("::1", Verdict.PASS), ("0.0.0.0", Verdict.FAIL), ("::", Verdict.FAIL)],  # noqa: S104
)
def test_robots_that_can_be_reached_from_beyond_this_host_fail(
    monkeypatch: pytest.MonkeyPatch, address: str, verdict: Verdict
) -> None:
    monkeypatch.setattr(surroundings, "listening", lambda: {(address, 7447): "python -m robots"})
    outcome, _ = try_clause(CLAUSES["host.alone"], WireHarness(WireRobot))
    assert outcome.verdict is verdict
    assert verdict is Verdict.PASS or "port 7447 of 'python -m robots'" in outcome.reason
