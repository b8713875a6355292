"""The commands, as a user starts them."""

from __future__ import annotations

import json
import signal
import tomllib

from tests.adapters.velocity_controlled.processes import EXAMPLES, soter


def test_a_mission_runs_against_robots_that_were_started_by_hand() -> None:
    with soter("sim", "zenoh", str(EXAMPLES / "surveillance.xml"), "--robots", "1") as simulator:
        assert simulator.stdout is not None
        lines: list[str] = []
        while not lines or not lines[-1].startswith("Ctrl-C"):
            lines.append(simulator.stdout.readline())
            assert lines[-1], simulator.communicate()
        text = "".join(lines)
        told = tomllib.loads(text[text.index("[backends.zenoh]") : text.index("Keys")])["backends"]["zenoh"]
        assert told["robots"] == {"1": {"namespace": "robot1"}}
        settings = (
            f"truth='{told['truth']}'", f"session.connect={told['session']['connect']}", "robots.1.namespace='robot1'",
        )  # fmt: skip
        with soter(
            "run", str(EXAMPLES / "surveillance.toml"), "--backend", "zenoh", "--planner", "straight-line",
            "--robots", "1", "--duration", "4", "--json", "-", "--no-record",
            *(part for each in settings for part in ("--set", f"backends.zenoh.{each}")),
        ) as process:  # fmt: skip
            out, err = process.communicate(timeout=100)
        assert process.returncode == 0, err
        result = json.loads(out)
        assert (result["status"], result["backend"]) == ("completed", "zenoh")
        assert sum(result["violations"].values()) == 0
        assert simulator.poll() is None, "they are not the run's to end"
        simulator.send_signal(signal.SIGINT)
        _, err = simulator.communicate(timeout=30)
    assert simulator.returncode == 0, err


def test_the_mux_says_itself_what_it_takes() -> None:
    with soter("zenoh-mux", "--help") as process:
        out, _ = process.communicate(timeout=60)
    assert process.returncode == 0
    assert "--yaw-rate-max" in out
    with soter("zenoh-mux", "--robot", "/robot1") as process:
        _, err = process.communicate(timeout=60)
    assert process.returncode == 2
    assert "--robot is '/robot1', allowed: a key such as robot1/odom" in err
