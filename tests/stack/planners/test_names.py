"""Planners by name, and what is said when there is none."""

from __future__ import annotations

import re
import sys

import pytest

from soter.config.mission_file import MissionFile
from soter.errors import BackendUnavailable, ConfigError
from soter.hints import install_command
from soter.stack.planners import PlannerSpec, PlanRequest
from soter.stack.planners.names import BUILT_IN, check_name, planner_class
from tests.stack.planners.misbehaving import Raises
from tests.stack.planners.places import CASE, RADIUS_M


def test_default_is_a_built_in_name() -> None:
    assert MissionFile.model_fields["planner"].default in BUILT_IN
    for name in BUILT_IN:
        check_name(name)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("ompl-bit*", "unknown planner 'ompl-bit.', did you mean 'ompl-bitstar'.*; known are ompl-bitstar, "),
        ("straightline", "did you mean 'straight-line'"),
        ("", "unknown planner ''"),
        ("a.b:", "unknown planner"),
        (":A", "unknown planner"),
        ("a..b:A", "unknown planner"),
        ("os.path:join;x", "unknown planner"),
    ],
)
def test_unknown_name_names_the_nearest(name: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        check_name(name)
    with pytest.raises(ConfigError, match=message):
        planner_class(name)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("no_such_module:Planner", "there is no module 'no_such_module'"),
        ("soter.stack.planners.base:StraightLin", "did you mean 'StraightLine'"),
        ("soter.stack.planners.base:annotations", "allowed: a subclass of Planner"),
        ("tests.stack.planners.misbehaving:NoPlanner", "allowed: a subclass of Planner"),
    ],
)
def test_dotted_path_that_leads_nowhere_is_refused(name: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        planner_class(name)


def test_dotted_path_is_found() -> None:
    assert planner_class("tests.stack.planners.misbehaving:Raises").__name__ == Raises.__name__


def test_missing_library_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "soter.stack.planners.sampling", raising=False)
    monkeypatch.setitem(sys.modules, "ompl", None)
    monkeypatch.setitem(sys.modules, "ompl.base", None)
    with pytest.raises(BackendUnavailable, match=re.escape(install_command("ompl"))):
        PlannerSpec("ompl-bitstar", CASE, RADIUS_M).build()


def test_straight_line_drives_at_the_goal_whatever_is_there() -> None:
    planner = PlannerSpec("straight-line", CASE, RADIUS_M).build()
    assert planner.plan(PlanRequest(1, 1, (1.0, 1.0), (2.5, 9.0))).path == ((2.5, 9.0),)
