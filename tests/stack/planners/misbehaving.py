"""Planners that break every promise for goals west of the workspace, and drive straight at all others."""

from __future__ import annotations

import itertools
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, ClassVar, cast

from soter.geometry.workspace import Workspace
from soter.stack.planners import Planner, PlanRequest, PlanResult
from soter.stack.planners.base import PlannerOptions


class BadPlanner(Planner):
    def plan(self, request: PlanRequest) -> PlanResult:
        if request.goal[0] < 0.0:
            return cast(PlanResult, self.misbehave(request))
        return PlanResult(request.request_id, (request.goal,), 1)

    def misbehave(self, request: PlanRequest) -> Any:
        raise NotImplementedError


class Raises(BadPlanner):
    def misbehave(self, request: PlanRequest) -> Any:
        raise ValueError("no\nidea " + "x" * 10_000)


class Exits(BadPlanner):
    def misbehave(self, request: PlanRequest) -> Any:
        sys.exit(3)


class Unprintable(BadPlanner):
    def misbehave(self, request: PlanRequest) -> Any:
        class Odd(Exception):
            def __str__(self) -> str:
                raise RuntimeError

        raise Odd


KINDS = (
    "none", "bare path", "text", "another request", "id of a type", "not a number", "infinite", "beyond floats",
    "too long", "endless", "words", "flat", "three", "truth", "neither", "negative", "half", "reason", "failure",
)  # fmt: skip


class AnswersOptions(PlannerOptions):
    kind: str = "any"


class Answers(BadPlanner):
    """Returns the kind of garbage that the seed says."""

    options_model: ClassVar[type[PlannerOptions]] = AnswersOptions

    def misbehave(self, request: PlanRequest) -> Any:
        number, here = request.request_id, request.goal
        wild = cast(Any, PlanResult)
        return {
            "none": None,
            "bare path": [here],
            "text": "go home",
            "another request": PlanResult(number + 1, (here,), 1),
            "id of a type": wild(str(number), (here,), 1),
            "not a number": PlanResult(number, ((float("nan"), 0.0),), 1),
            "infinite": PlanResult(number, ((0.0, float("inf")),), 1),
            "beyond floats": wild(number, ((10**400, 0.0),), 1),
            "too long": PlanResult(number, (here,) * 1001, 1),
            "endless": wild(number, itertools.repeat(here), 1),
            "words": wild(number, (("a", "b"),), 1),
            "flat": wild(number, here, 1),
            "three": wild(number, ((*here, 0.0),), 1),
            "truth": wild(number, ((True, False),), 1),
            "neither": PlanResult(number, (), 1),
            "negative": PlanResult(number, (here,), -1),
            "half": wild(number, (here,), 0.5),
            "reason": wild(number, (), 1, 17),
            "failure": PlanResult.failed(number, "r" * 10_000, 50),
        }[KINDS[request.seed]]


class Sleeps(BadPlanner):
    def misbehave(self, request: PlanRequest) -> Any:
        time.sleep(600.0)


class Spins(BadPlanner):
    def misbehave(self, request: PlanRequest) -> Any:
        while True:
            pass


class HoldsTheInterpreter(BadPlanner):
    """Spends an age inside one call of C that lets no other thread run."""

    def misbehave(self, request: PlanRequest) -> Any:
        re.match(r"(a+)+$", "a" * 200 + "b")


class Ignores(BadPlanner):
    """Will not be asked politely to end."""

    def misbehave(self, request: PlanRequest) -> Any:
        for number in (signal.SIGTERM, signal.SIGIO, signal.SIGHUP):
            signal.signal(number, signal.SIG_IGN)
        time.sleep(600.0)


class Dies(BadPlanner):
    def misbehave(self, request: PlanRequest) -> Any:
        os._exit(3)


class IsKilled(BadPlanner):
    def misbehave(self, request: PlanRequest) -> Any:
        os.kill(os.getpid(), signal.SIGSEGV)


class EatsMemory(BadPlanner):
    def misbehave(self, request: PlanRequest) -> Any:
        kept = []
        while True:
            kept.append(bytearray(1 << 24))


class WritesToTheSocket(BadPlanner):
    """Finds the socket to the mission and writes to it."""

    def misbehave(self, request: PlanRequest) -> Any:
        # Its number is the mission's, and high in a mission that has many files open.
        for fd in [int(entry.name) for entry in Path("/proc/self/fd").iterdir()]:
            if fd <= 2:
                continue
            try:
                os.write(fd, b'[0, 0, [["x", 1]]')
            except OSError:
                continue
        return PlanResult(request.request_id, (request.goal,), 1)


class FileOptions(PlannerOptions):
    pid_file: str


class HasChildren(BadPlanner):
    """Starts a program and never returns."""

    options_model: ClassVar[type[PlannerOptions]] = FileOptions
    options: FileOptions

    def misbehave(self, request: PlanRequest) -> Any:
        child = subprocess.Popen(["sleep", "600"])
        Path(self.options.pid_file).write_text(str(child.pid))
        time.sleep(600.0)


class Talks(BadPlanner):
    """Prints, and reads what there is to read."""

    def misbehave(self, request: PlanRequest) -> Any:
        print("look at me")
        print("look at me", file=sys.stderr)
        read = os.read(0, 1)
        return PlanResult(request.request_id, (request.goal,), 1 + len(read))


class Costs(BadPlanner):
    """Charges a check for each centimetre that the goal is east."""

    def plan(self, request: PlanRequest) -> PlanResult:
        return PlanResult(request.request_id, (request.goal,), round(request.goal[0] * 100))


class DiesOnce(BadPlanner):
    """Dies between two requests, the first time."""

    options_model: ClassVar[type[PlannerOptions]] = FileOptions
    options: FileOptions

    def __init__(self, workspace: Workspace, body_radius_m: float, options: PlannerOptions) -> None:
        super().__init__(workspace, body_radius_m, options)
        flag = Path(self.options.pid_file)
        if not flag.exists():
            flag.touch()
            signal.signal(signal.SIGALRM, lambda *_: os._exit(1))
            signal.setitimer(signal.ITIMER_REAL, 0.1)


class CannotBeBuilt(BadPlanner):
    def __init__(self, workspace: Workspace, body_radius_m: float, options: PlannerOptions) -> None:
        raise LookupError("no licence")


class DiesWhenBuilt(BadPlanner):
    def __init__(self, workspace: Workspace, body_radius_m: float, options: PlannerOptions) -> None:
        os._exit(7)


class NeverBuilt(BadPlanner):
    def __init__(self, workspace: Workspace, body_radius_m: float, options: PlannerOptions) -> None:
        time.sleep(600.0)


class NoPlanner:
    """Is none."""
