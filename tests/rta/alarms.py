"""A robot for which every assumption holds, until a test breaks one."""

from __future__ import annotations

from typing import Any

from soter.rta import SUPERVISOR, Assumption, PeerMonitor, SpeedBound, Timing
from soter.rta.fleet import Supervisor
from soter.rta.supervisor import ALARM_S
from soter.sdk import Controller
from tests.rta.doubles import TICK_S, At, Rig

ALARM_TICKS = round(ALARM_S / TICK_S)
V_MAX = 0.22
SILENT_S = 0.5


def started(*names: str, timing: Timing | None = None, **values: float) -> Rig:
    """Return a rig whose AC has control and for which every assumption has held."""
    rig = Rig(*(names or ("a",)), timing=timing or Timing(latency_s=0.05, **values))
    rig.start()
    assert rig.robot.log.breaches == {}
    return rig


def put(rig: Rig, x_m: float = 10.0, **values: Any) -> None:
    rig.actuator.sample = At(x_m, stamp_s=rig.now_s)._replace(**values)


def found(rig: Rig, assumption: Assumption) -> str:
    """Check that this assumption alone was found not to hold, and that it cost the AC control; return the cause."""
    assert list(rig.robot.log.breaches) == [assumption]
    assert rig.robot.mode is Controller.SC
    record = rig.watch.records[0]
    assert (record.before, record.module) == (None, SUPERVISOR)
    cause = rig.robot.log.breaches[assumption].cause
    assert record.cause == f"{assumption.id}: {cause}"
    assert record.time_s == rig.robot.log.breaches[assumption].first_s
    return cause


def recovers(rig: Rig) -> None:
    """Check that the AC gets control back once the assumption holds again."""
    rig.tick(ALARM_TICKS + 3)
    assert rig.robot.mode is Controller.AC


def fleet() -> tuple[Supervisor, list[Rig]]:
    """Return three robots under one supervisor, the first two near each other, with their ACs in control."""
    rigs = [Rig("a", robot_id=number) for number in (1, 2, 3)]
    supervisor = Supervisor(
        [rig.robot for rig in rigs],
        TICK_S,
        2.5,
        peers=PeerMonitor({rig.robot.robot_id: (SpeedBound(V_MAX, 1.0), 0.0) for rig in rigs}, SILENT_S),
    )
    for tick in range(20):
        report(rigs, tick)
        supervisor.tick(tick * TICK_S)
    assert [rig.driver() for rig in rigs] == [None, None, None]
    for rig in rigs:
        # They were put there after they had been made.
        rig.robot.log.breaches.clear()
    return supervisor, rigs


def report(rigs: list[Rig], tick: int, **places: float) -> None:
    for rig in rigs:
        number = rig.robot.robot_id
        rig.actuator.sample = At(places.get(f"r{number}", 10.0 + number), stamp_s=tick * TICK_S, robot_id=number)
