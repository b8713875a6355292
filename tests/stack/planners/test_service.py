"""Whatever a planner does costs its robot a plan and nothing else; deliveries follow virtual time."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from soter.errors import ConfigError
from soter.stack.planners import PlannerSpec, PlanRequest, PlanResult
from soter.stack.planners.names import PlannerUnavailable
from soter.stack.planners.service import PlanService
from tests.stack.planners.misbehaving import KINDS
from tests.stack.planners.places import CASE, RADIUS_M
from tests.waiting import gone, wait_until

HERE = "tests.stack.planners.misbehaving"

Open = Callable[..., PlanService]


@pytest.fixture
def opened() -> Iterator[Open]:
    with contextlib.ExitStack() as stack:

        def make(
            planner: str, options: dict[str, Any] | None = None, source: str | None = None, **more: Any
        ) -> PlanService:
            spec = PlannerSpec(planner, CASE, RADIUS_M, options or {}, source)
            service = stack.enter_context(PlanService(spec, **more))
            service.ready()
            return service

        yield make


@pytest.fixture(scope="module")
def answers() -> Iterator[PlanService]:
    with PlanService(PlannerSpec(f"{HERE}:Answers", CASE, RADIUS_M)) as service:
        yield service


def request(number: int, goal: tuple[float, float] = (4.0, 4.0)) -> PlanRequest:
    return PlanRequest(number, 1, (1.0, 1.0), goal)


def answer(service: PlanService, number: int, goal: tuple[float, float], now_s: float = 0.0) -> PlanResult:
    """What the service delivers within the longest time that a plan can cost."""
    service.submit(request(number, goal), now_s)
    (result,) = service.due(now_s + 1.0)
    return result


BAD, GOOD = (-1.0, 2.0), (3.0, 2.0)


@pytest.mark.parametrize(
    ("planner", "reason"),
    [
        ("Raises", "the planner raised ValueError: no idea xxx"),
        ("Exits", "the planner raised SystemExit: 3"),
        ("Unprintable", "the planner raised Odd: no message"),
    ],
)
def test_exception_costs_the_plan_and_nothing_else(opened: Open, planner: str, reason: str) -> None:
    service = opened(f"{HERE}:{planner}")
    pids = service.pids
    result = answer(service, 1, BAD)
    assert not result.ok
    assert result.reason is not None
    assert result.reason.startswith(reason)
    assert len(result.reason) < 400
    assert result.path == ()
    assert answer(service, 2, GOOD).path == (GOOD,)
    assert service.pids == pids
    assert not service.incidents


@pytest.mark.parametrize(
    ("kind", "reason"),
    [
        ("none", "garbage: the planner returned NoneType, not PlanResult"),
        ("bare path", "garbage: the planner returned list, not PlanResult"),
        ("text", "garbage: the planner returned str, not PlanResult"),
        ("another request", "garbage: the answer to another request"),
        ("id of a type", "garbage: the answer to another request"),
        ("not a number", "garbage: a waypoint that is not finite"),
        ("infinite", "garbage: a waypoint that is not finite"),
        ("beyond floats", "garbage: a waypoint with a number too large for a float"),
        ("too long", "garbage: 1001 waypoints, allowed are 1000"),
        ("endless", "garbage: a path of type repeat"),
        ("words", "garbage: a waypoint that is not a pair of numbers"),
        ("flat", "garbage: a waypoint that is not a pair of numbers"),
        ("three", "garbage: a waypoint that is not a pair of numbers"),
        ("truth", "garbage: a waypoint that is not a pair of numbers"),
        ("neither", "garbage: neither a path nor a reason"),
        ("negative", "garbage: a number of checks that is not a natural number"),
        ("half", "garbage: a number of checks that is not a natural number"),
        ("reason", "garbage: a reason of type int"),
        ("failure", "r" * 300),
    ],
)
def test_garbage_is_a_failed_plan(answers: PlanService, kind: str, reason: str) -> None:
    number = KINDS.index(kind)
    answers.submit(PlanRequest(number, 1, (1.0, 1.0), BAD, seed=number), 0.0)
    (result,) = answers.due(1.0)
    assert (result.ok, result.path, result.reason) == (False, (), reason)
    assert answer(answers, 100, GOOD).path == (GOOD,)
    assert not answers.incidents


@pytest.mark.parametrize("planner", ["Sleeps", "Spins", "HoldsTheInterpreter", "Ignores"])
def test_silence_beyond_the_limit_costs_the_worker(opened: Open, planner: str) -> None:
    service = opened(f"{HERE}:{planner}", time_limit_s=0.5)
    pids = service.pids
    service.submit(request(1, BAD), 0.0)
    service.submit(request(2, GOOD), 0.0)
    assert service.due(0.0) == []
    (result,) = service.due(0.05)
    assert (result.request_id, result.ok) == (2, True)
    (result,) = service.due(1.0)
    assert result.reason == "the planner did not answer within 0.5 s of host time"
    assert service.incidents
    assert service.incidents == ("request 1: the planner did not answer within 0.5 s of host time",)
    assert service.pids != pids
    assert gone(pids[0])


@pytest.mark.parametrize(("planner", "end"), [("Dies", "exit code 3"), ("IsKilled", "signal SIGSEGV")])
def test_dead_worker_is_replaced(opened: Open, planner: str, end: str) -> None:
    service = opened(f"{HERE}:{planner}")
    for number in (1, 3):
        assert answer(service, number, BAD).reason == f"the worker died ({end})"
        assert answer(service, number + 1, GOOD).path == (GOOD,)
    assert service.incidents
    assert len(service.incidents) == 2


def test_worker_that_dies_while_idle_costs_nothing(opened: Open, tmp_path: Path) -> None:
    service = opened(f"{HERE}:DiesOnce", {"pid_file": str(tmp_path / "flag")})
    (pid,) = service.pids
    wait_until(lambda: gone(pid))
    assert answer(service, 1, GOOD).path == (GOOD,)
    assert not service.incidents


def test_memory_is_limited(opened: Open) -> None:
    service = opened(f"{HERE}:EatsMemory", memory_limit_bytes=1 << 28)
    assert answer(service, 1, BAD).reason == "the planner raised MemoryError:"
    assert answer(service, 2, GOOD).path == (GOOD,)


def test_forged_answer_is_garbage(opened: Open) -> None:
    service = opened(f"{HERE}:WritesToTheSocket")
    assert "garbage: a malformed message" in str(answer(service, 1, BAD).reason)
    assert answer(service, 2, GOOD).path == (GOOD,)
    assert service.incidents


def test_children_of_a_worker_are_killed_with_it(opened: Open, tmp_path: Path) -> None:
    file = tmp_path / "pid"
    service = opened(f"{HERE}:HasChildren", {"pid_file": str(file)}, time_limit_s=0.5)
    assert not answer(service, 1, BAD).ok
    # Nobody waits for it: it has been killed, and ends when the host comes to it.
    wait_until(lambda: gone(int(file.read_text())))


def test_worker_has_no_standard_streams(opened: Open, capfd: pytest.CaptureFixture[str]) -> None:
    service = opened(f"{HERE}:Talks")
    assert answer(service, 1, BAD).checks == 1
    assert capfd.readouterr() == ("", "")


def test_worker_ignores_ctrl_c(opened: Open) -> None:
    service = opened("straight-line", in_process=False)
    (pid,) = service.pids
    assert os.getsid(pid) == pid
    os.kill(pid, signal.SIGINT)
    assert answer(service, 1, GOOD).ok
    assert not service.incidents


def test_close_leaves_no_process() -> None:
    service = PlanService(PlannerSpec(f"{HERE}:Spins", CASE, RADIUS_M))
    service.ready()
    (pid,) = service.pids
    service.submit(request(1, BAD), 0.0)
    began = time.perf_counter()
    service.close()
    service.close()
    assert time.perf_counter() - began < 2.0
    with pytest.raises(ChildProcessError):
        os.waitpid(pid, 0)
    with pytest.raises(RuntimeError, match="closed"):
        service.submit(request(2), 0.0)
    assert service.due(9.0) == []


@pytest.mark.parametrize("planner", ["straight-line", f"{HERE}:HoldsTheInterpreter"])
def test_workers_die_with_the_mission(planner: str) -> None:
    script = f"""if True:
        import os
        from soter.stack.planners import PlannerSpec, PlanRequest
        from soter.stack.planners.service import PlanService
        from tests.stack.planners.places import CASE
        service = PlanService(PlannerSpec({planner!r}, CASE, 0.1), in_process=False)
        service.ready()
        service.submit(PlanRequest(1, 1, (1.0, 1.0), (-1.0, 1.0)), 0.0)
        print(*service.pids, flush=True)
        os.kill(os.getpid(), 9)
    """
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, env=_with_path(), check=False)
    assert done.returncode == -9, done.stderr
    wait_until(lambda: gone(int(done.stdout)))


def _with_path() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}


def test_main_module_is_not_run_again(tmp_path: Path) -> None:
    file = tmp_path / "mission.py"
    file.write_text(
        "print('main')\n"
        "from soter.stack.planners import PlannerSpec, PlanRequest\n"
        "from soter.stack.planners.service import PlanService\n"
        "from tests.stack.planners.places import CASE\n"
        "with PlanService(PlannerSpec('straight-line', CASE, 0.1), in_process=False) as service:\n"
        "    service.submit(PlanRequest(1, 1, (1.0, 1.0), (2.0, 1.0)), 0.0)\n"
        "    print(service.due(0.05)[0].path)\n"
    )
    done = subprocess.run([sys.executable, file], capture_output=True, text=True, env=_with_path(), check=False)
    assert (done.stdout, done.stderr) == ("main\n((2.0, 1.0),)\n", "")


def test_delivery_is_at_request_plus_cost(opened: Open) -> None:
    service = opened(f"{HERE}:Costs")
    service.submit(request(1, (5.0, 1.0)), 10.0)  # 500 checks: 10 ms
    assert service.due(10.0) == []
    assert service.due(10.009) == []
    assert [result.request_id for result in service.due(10.010001)] == [1]
    assert service.due(99.0) == []


def test_no_plan_costs_more_than_a_second_or_nothing(opened: Open) -> None:
    service = opened(f"{HERE}:Costs")
    service.submit(request(1, (1e6, 1.0)), 0.0)
    assert service.due(0.99) == []
    assert len(service.due(1.0)) == 1
    service.submit(request(2, (0.0, 1.0)), 1.0)
    assert service.due(1.0) == []
    assert len(service.due(1.00002)) == 1


def test_deliveries_have_one_order(opened: Open) -> None:
    service = opened(f"{HERE}:Costs")
    for number, east_m in enumerate((4.0, 1.0, 3.0, 1.0, 2.0)):
        service.submit(request(number, (east_m, 1.0)), 0.0)
    service.submit(request(9, (0.5, 1.0)), 0.0005)
    assert [result.request_id for result in service.due(0.0061)] == [9, 1, 3, 4, 2]
    assert [result.request_id for result in service.due(1.0)] == [0]


def test_nothing_waits_for_what_cannot_be_due(opened: Open) -> None:
    service = opened(f"{HERE}:Sleeps", time_limit_s=30.0)
    service.submit(request(1, BAD), 5.0)
    began = time.perf_counter()
    assert service.due(5.0) == []
    assert time.perf_counter() - began < 5.0


def test_on_a_wall_clock_nothing_waits_at_all(opened: Open) -> None:
    service = opened(f"{HERE}:Sleeps", virtual_time=False, time_limit_s=0.3)
    service.submit(request(1, GOOD), 0.0)
    service.submit(request(2, BAD), 0.0)
    got: list[PlanResult] = []

    def both_came() -> bool:
        got.extend(service.due(7.0))
        return len(got) == 2

    wait_until(both_came)
    assert [(result.request_id, result.ok) for result in got] == [(1, True), (2, False)]


def test_trusted_planner_gives_the_same_in_process_and_in_a_worker(opened: Open) -> None:
    one, other = opened("straight-line"), opened("straight-line", in_process=False)
    assert (len(one.pids), len(other.pids)) == (0, 1)
    for number, goal in enumerate([(0.1, 0.2), (-3.0, 1 / 3), (1e-300, 5e5)]):
        assert answer(one, number, goal) == answer(other, number, goal) == PlanResult(number, (goal,), 1)


def test_misuse_is_refused(opened: Open) -> None:
    service = opened("straight-line")
    service.submit(request(1), 0.0)
    with pytest.raises(ValueError, match="request 1 is pending"):
        service.submit(request(1), 0.0)
    with pytest.raises(ValueError, match="finite"):
        request(2, (float("nan"), 0.0))


def test_bad_options_show_before_anything_moves(opened: Open, tmp_path: Path) -> None:
    mission = tmp_path / "mission.toml"
    mission.write_text(f"[planners.'{HERE}:Answers']\nkin = 'none'\n")
    for name, source in (("straight-line", None), (f"{HERE}:Answers", str(mission))):
        with pytest.raises(ConfigError, match=r"kin.*allowed.*clearance_m"):
            opened(name, {"kin": "none"}, source=source)
    with pytest.raises(ConfigError, match="did you mean 'kind'") as caught:
        opened(f"{HERE}:Answers", {"kin": "none"}, source=str(mission))
    assert caught.value.source == str(mission)
    assert str(caught.value).count("mission.toml") == 1


@pytest.mark.parametrize(
    ("planner", "error", "message"),
    [
        ("CannotBeBuilt", ConfigError, "cannot be made: LookupError: no licence"),
        ("NoPlanner", ConfigError, "a subclass of Planner"),
        ("Raise", ConfigError, "did you mean 'Raises'"),
        ("DiesWhenBuilt", PlannerUnavailable, "could not be started .exit code 7"),
        ("NeverBuilt", PlannerUnavailable, "did not start within 1 s"),
    ],
)
def test_planner_that_cannot_start_is_an_error(
    opened: Open, planner: str, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        opened(f"{HERE}:{planner}", start_limit_s=1.0 if planner == "NeverBuilt" else 60.0)


def test_planner_that_cannot_start_again_costs_plans_only() -> None:
    with PlanService(PlannerSpec(f"{HERE}:DiesWhenBuilt", CASE, RADIUS_M)) as service:
        for number in range(2):
            assert answer(service, number, GOOD).reason == "the worker died (exit code 7)"
