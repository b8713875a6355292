"""A robot of a mission in real processes is cut off, on loopback and briefly; `make test-distributed` takes longer."""

from __future__ import annotations

import socket
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from tools import distribution
from tools.distribution import HOLDS_WITHIN_S, Found
from tools.distribution_hosts import Proxy, make_hosts


@pytest.mark.long
def test_a_robot_that_is_cut_off_and_its_peer_hold_and_go_on(tmp_path: Path) -> None:
    given = distribution.parse(
        ["--before-s", "1.5", "--cut-s", "2.5", "--after-s", "10", "--targets", "uniform", "--seed", "3"]
    )
    hosts = make_hosts("loopback", [*distribution.ROBOTS], [distribution.PLANNER])
    try:
        found = distribution.play(hosts, tmp_path, given)
    finally:
        hosts.close()
    assert not found.violations
    assert set(found.statuses.values()) == {"completed"}, found
    assert all(after_s < HOLDS_WITHIN_S for after_s in found.rest_after_s.values()), found
    printed = [each.read_text(errors="replace")[-2000:] for each in sorted(tmp_path.glob("*.out"))]
    said = "\n".join([str(found), *printed])
    assert all(after_s is not None for after_s in found.ac_after_s.values()), said
    # Where both ways cross one waits for the other, as ever.
    assert any(after_s is not None for after_s in found.moves_after_s.values()), said
    assert all(age["p50"] < 150.0 for age in found.peer_age_ms.values()), found


GOOD = Found(
    "loopback", [], 4.0, {"alpha": 0.6}, {"alpha": 0.5}, {"alpha": 0.5}, 1, 1, 1, {}, {}, {}, {"alpha": "completed"}
)


def test_what_should_not_have_happened_is_said() -> None:
    assert GOOD.wrong() == []
    bad = replace(
        GOOD, violations=[["collision", [1, 2], 1.0, 2.0]], rest_after_s={"alpha": 3.0}, ac_after_s={"alpha": None},
        ended_after=0, statuses={"alpha": "failed"},
    )  # fmt: skip
    wrong = "\n".join(bad.wrong())
    for words in ("collision", "ended as failed", "only 3.00 s after", "'alpha' did not go on", "no target ended"):
        assert words in wrong


def test_a_proxy_passes_bytes_until_it_is_cut_and_again_when_it_is_not() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        proxy = Proxy(f"127.0.0.1:{server.getsockname()[1]}")
        try:
            host, _, port = proxy.address.rpartition(":")
            with socket.create_connection((host, int(port)), 5.0) as client, server.accept()[0] as served:
                served.settimeout(5.0)
                client.sendall(b"one")
                assert served.recv(10) == b"one"
                proxy.cut = True
                threading.Event().wait(0.1)
                client.sendall(b"two")
                served.settimeout(0.3)
                with pytest.raises(TimeoutError):
                    served.recv(10)
                proxy.cut = False
                served.settimeout(5.0)
                assert served.recv(10) == b"two"
                client.close()
                assert served.recv(10) == b""
        finally:
            proxy.close()
