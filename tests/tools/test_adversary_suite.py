"""The evaluation of adversaries: its runs, its criteria, its page."""

from __future__ import annotations

from functools import cache
from typing import Any

import pytest

from soter.cli.overrides import merge
from soter.config import load_mission
from soter.runner import RunResult, run_mission
from soter.sdk import RULES
from soter.stack.adversaries import BUILT_IN, PREFIX
from tools import accept
from tools.acceptance.adversaries import (
    DISTANCES,
    ENGINES,
    LINKS,
    SEEDS,
    adversary_cases,
    adversary_criteria,
    least_part,
    reach_m,
)
from tools.acceptance.adversary_page import adversary_section
from tools.acceptance.cases import Case
from tools.acceptance.judge import Outcome, Verdict
from tools.acceptance.store import ROOT

MISSION = ROOT / "examples" / "surveillance.toml"


@cache
def real_result() -> RunResult:
    overrides = {"backend": "kinematic", "duration_s": 1.0, "ac": f"{PREFIX}frozen"}
    return run_mission(load_mission(MISSION, overrides)).result


def result_of(case: Case, part: float = 0.05, **changes: Any) -> RunResult:
    """What a good run of a case looks like, its margins at so much of R(H)."""
    bounds = reach_m(case)
    margins = {rule: part * bounds.get(rule, 1.0) for rule in RULES}
    modules = tuple(name for name in ("collision", "obstacle", "geofence", "battery") if name in {*bounds, "battery"})
    usual = {"duration_s": case.duration_s, "robots": 2, "modules": modules, "min_margin": margins}
    return real_result().model_copy(update={**usual, "violations": dict.fromkeys(RULES, 0), **changes})


def verdicts(outcomes: list[Outcome]) -> list[Verdict]:
    return [each.verdict for each in adversary_criteria(outcomes)]


def test_every_adversary_runs_on_both_engines_with_every_seed() -> None:
    plain = {(case.subject, case.engine, case.seed) for case in adversary_cases() if case.group == "adversary"}
    assert plain == {(name, engine, seed) for name in BUILT_IN for engine in ENGINES for seed in SEEDS}
    assert len({case.name for case in adversary_cases()}) == len(adversary_cases())
    assert {case.duration_s for case in adversary_cases()} == {3600.0}


def test_the_reach_bounds_are_those_of_the_faults_too() -> None:
    found = {case.group: reach_m(case) for case in adversary_cases() if case.engine == "kinematic"}
    assert found["adversary"]["collision"] == pytest.approx(2 * (0.22 * 0.15 + 0.0242))
    assert found["adversary"]["geofence"] == pytest.approx(0.22 * 0.15 + 0.0242)
    assert found["late"]["geofence"] == pytest.approx(0.22 * 0.2 + 0.0242)
    assert set(found["stretched"]) == {"obstacle", "geofence"}
    assert found["stretched"]["obstacle"] == pytest.approx(0.22 * 1.25 + 0.0242)
    assert set(found["apart"]) == {"collision", "geofence"}
    assert found["apart"]["collision"] == pytest.approx(2 * (0.22 * 1.25 + 0.0242))


@pytest.mark.parametrize("group", ["adversary", "stretched", "apart", *LINKS])
def test_every_case_opens(group: str) -> None:
    case = next(c for c in adversary_cases() if c.group == group and c.engine == "kinematic")
    options = dict(zip(case.options[::2], case.options[1::2], strict=True))
    assert options["--ac"] == f"{PREFIX}{case.subject}"
    settings = [value for option, value in zip(case.options[::2], case.options[1::2], strict=True) if option == "--set"]
    overrides = merge({}, settings)
    mission = load_mission(MISSION, {**overrides, "backend": "kinematic", "ac": options["--ac"], "duration_s": 0.5})
    assert run_mission(mission).result.status == "completed"


def test_all_good_is_reached_and_any_violation_is_not() -> None:
    outcomes = [Outcome(case, result_of(case)) for case in adversary_cases()]
    assert set(verdicts(outcomes)) == {Verdict.REACHED}
    case = outcomes[5].case
    outcomes[5] = Outcome(case, result_of(case, violations={**dict.fromkeys(RULES, 0), "obstacle": 1}))
    assert verdicts(outcomes)[0] is Verdict.NOT_REACHED


def test_rules_without_a_module_do_not_count() -> None:
    outcomes = [Outcome(case, result_of(case)) for case in adversary_cases()]
    last = next(case for case in adversary_cases() if case.group == "stretched")
    outcomes = [o for o in outcomes if o.case != last]
    outcomes.append(Outcome(last, result_of(last, violations={**dict.fromkeys(RULES, 0), "collision": 9})))
    assert set(verdicts(outcomes)) == {Verdict.REACHED}


@pytest.mark.parametrize(("part", "reached"), [(0.05, True), (0.59, False), (0.61, False), (-0.01, False)])
def test_margins_have_to_be_small_but_not_negative(part: float, reached: bool) -> None:
    outcomes = [Outcome(case, result_of(case, part)) for case in adversary_cases()]
    assert (set(verdicts(outcomes)) == {Verdict.REACHED}) is reached


def test_what_is_missing_is_incomplete_and_a_run_without_truth_proves_nothing() -> None:
    assert set(verdicts([Outcome(case, None) for case in adversary_cases()])) <= {Verdict.INCOMPLETE}
    case = adversary_cases()[0]
    blind = Outcome(case, result_of(case, violations=None))
    assert Verdict.NOT_REACHED in verdicts([blind])


def test_the_least_part_names_its_run() -> None:
    cases = [case for case in adversary_cases() if case.group == "adversary"][:3]
    outcomes = [Outcome(case, result_of(case, 0.1 * (index + 1))) for index, case in enumerate(reversed(cases))]
    found = least_part(outcomes, "geofence")
    assert found is not None
    assert found[0] == pytest.approx(0.1)
    assert found[1].case == cases[-1]


def test_the_page_has_every_run_and_every_margin() -> None:
    outcomes = [Outcome(case, result_of(case)) for case in adversary_cases()]
    text = adversary_section(outcomes, adversary_criteria(outcomes), "source", 1.0)
    for outcome in outcomes:
        assert f"`{outcome.case.command()}`" in text
    lines = {(o.case.group, o.case.subject, o.case.engine) for o in outcomes}
    one_less = {line for line in lines if line[0] in ("stretched", "apart")}
    assert text.count("= 0.05 R |") == len(lines) * len(DISTANCES) - len(one_less)


def test_the_suite_is_chosen_by_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert accept.main(["--suite", "adversaries", "--list", "--only", "late-chase-*"]) == 0
    assert capsys.readouterr().out.count("soter run") == 3
