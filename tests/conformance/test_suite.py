"""The kit as tests, as a third party subclasses it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from soter.conformance import CLAUSES, HOOKS, Harness, find_harness
from soter.conformance.testing import AdapterSuite
from soter.sdk import Fleet
from tests.broken.goals import NoOpStop
from tests.conformance.failing import Dead
from tests.conformance.simulated import SimulatedHarness
from tests.conformance.wire import WireHarness, WireRobot
from tests.project.source import ROOT

PROGRAM = """
from soter.conformance import find_harness
from soter.conformance.testing import AdapterSuite


class TestKinematic(AdapterSuite):
    harness = staticmethod(lambda: find_harness("kinematic"))
"""


class Suite(AdapterSuite):
    harness = staticmethod(lambda: find_harness("kinematic"))


class BrokenSuite(AdapterSuite):
    harness = staticmethod(lambda: SimulatedHarness(NoOpStop))


class DeadSuite(AdapterSuite):
    harness = staticmethod(lambda: SimulatedHarness(Dead))


class NoHooks(Harness):
    """Opens robots behind a link that nothing can be done to."""

    name = "no hooks"

    def __init__(self) -> None:
        self.world = WireHarness(WireRobot)

    def open(self, robots: int) -> Fleet:
        return self.world.open(robots)

    def close(self) -> None:
        self.world.close()


class WireSuite(AdapterSuite):
    harness = NoHooks


def test_pytest_makes_one_test_of_each_clause(tmp_path: Path) -> None:
    (tmp_path / "test_mine.py").write_text(PROGRAM, encoding="utf-8")
    listed = run_pytest(tmp_path, "--collect-only")
    assert f"{len(CLAUSES)} tests collected" in listed, listed
    done = run_pytest(tmp_path, "-k", "lifecycle or link")
    chosen = [clause for name, clause in CLAUSES.items() if "lifecycle" in name or "link" in name]
    wire = sum(clause.tier.value == "wire" for clause in chosen)
    assert f"{len(chosen) - wire} passed, {wire} skipped" in done, done


def run_pytest(folder: Path, *arguments: str) -> str:
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-o", f"pythonpath={ROOT} {ROOT / 'sim'}",
         "-c", "/dev/null", "--rootdir", str(folder), str(folder), *arguments],
        capture_output=True, text=True, cwd=folder,
    )  # fmt: skip
    return done.stdout + done.stderr


def test_a_clause_that_fails_fails_its_test() -> None:
    with pytest.raises(AssertionError, match=r"goal\.cancel: .*\nFAIL: .* still moves"):
        BrokenSuite().test_clause("goal.cancel")


def test_a_hook_may_be_missing_in_process_but_not_on_a_wire() -> None:
    with pytest.raises(Exception, match="NOT TESTED: hook not given: cut") as skipped:
        Suite().test_clause("link.age")
    assert type(skipped.value).__name__ == "SkipTest"
    with pytest.raises(AssertionError, match="NOT TESTED: hook not given: cut"):
        WireSuite().test_clause("link.age")


def test_robots_that_are_never_there_are_not_waited_for_in_every_test() -> None:
    for clause in ("lifecycle.init", "state.start"):
        with pytest.raises(AssertionError, match="nobody answers"):
            DeadSuite().test_clause(clause)
    with pytest.raises(
        AssertionError, match=r"NOT TESTED: no robot was ever ready, as lifecycle\.init and state\.start"
    ):
        DeadSuite().test_clause("goto.arrives")


def test_nothing_of_it_imports_pytest() -> None:
    program = (
        "import sys, soter.conformance.testing; assert 'pytest' not in sys.modules; assert 'rich' not in sys.modules"
    )
    subprocess.run([sys.executable, "-W", "error", "-c", program], cwd=ROOT, check=True)


def test_a_harness_gives_what_it_overrides() -> None:
    class Half(NoHooks):
        def cut(self, robot_id: int) -> None:
            pass

        def delay(self, seconds: float) -> None:
            pass

    half = Half()
    # A link that is cut must be restored too.
    assert [hook for hook in HOOKS if half.gives(hook)] == ["delay"]
