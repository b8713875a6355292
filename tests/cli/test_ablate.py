"""`soter ablate`: what it tries, what it refuses, what it shows and writes."""

from __future__ import annotations

import io
import json
import os
import re
import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console
from typer.testing import CliRunner, Result

from soter.ablation import ablate
from soter.ablation.ablate import Plan, Variant, VariantRefusal, VariantRun, variants
from soter.ablation.tables import GROUPS, HEAD, ac_only, markdown, rows
from soter.cli import app
from soter.cli.ablate import _show
from soter.config import load_mission
from soter.config.tables import MODULES
from soter.controllers import ADVERSARIES
from soter.errors import ConfigError, RunFailed
from soter.registry import load_backend
from soter.runner import RunResult, Study, run_mission
from soter.sdk import RULES
from tests.cli.conftest import MISSION
from tests.project.source import ROOT

QUICK = {"backend": "kinematic", "planner": "straight-line", "duration_s": 20.0, "targets": "hostile"}


def ablated(*arguments: str | Path) -> Result:
    """`soter ablate` on the surveillance mission; its workers are processes of their own."""
    options = [str(MISSION), "--duration", "5", "--seeds", "1", *map(str, arguments)]
    return CliRunner().invoke(app, ["ablate", *options], env={"COLUMNS": "300"})


def plan(**overrides: Any) -> Plan:
    """A plan for runs in this process."""
    force = overrides.pop("force", False)
    return Plan(MISSION, {**QUICK, **overrides}, (1,), force)


def named(group: str, name: str) -> Variant:
    """The variant of that name."""
    return next(variant for variant in variants() if (variant.group, variant.name) == (group, name))


def test_every_part_is_varied() -> None:
    groups = {variant.group for variant in variants()}
    assert len({(variant.group, variant.name) for variant in variants()}) == len(variants())
    for module in MODULES:
        assert named("without a module", module).overrides["rta.modules"] == [m for m in MODULES if m != module]
        assert {f"Delta of {module}", f"phi_safer of {module}"} <= groups
    for name in ADVERSARIES:
        assert named("adversary", name).intact
    assert all(any(group.startswith(begin) for begin in GROUPS) for group in groups)


def test_every_variant_is_a_mission() -> None:
    for variant in variants():
        load_mission(MISSION, {**QUICK, **variant.overrides})


def test_it_runs_shows_and_writes(tmp_path: Path) -> None:
    page, written = tmp_path / "page.md", tmp_path / "all.json"
    done = ablated("--only", "mission", "--json", written, "--markdown", page)
    assert done.exit_code == 0, done.output
    assert "AC only (no RTA)" in done.stdout
    outcomes = json.loads(written.read_text())
    assert [outcome["variant"] for outcome in outcomes] == ["as declared", "AC only (no RTA)", "SC only"]
    assert RunResult.model_validate(outcomes[1]["result"]).ac_share == 1.0
    assert RunResult.model_validate(outcomes[2]["result"]).ac_share == 0.0
    assert "| as declared |" in page.read_text()


@pytest.mark.parametrize(
    "variant",
    [
        named("mission", "AC only (no RTA)"),
        named("adversary", "fastest-to-boundary"),
        named("Delta of obstacle", "0.05 s, adversary:fastest-to-boundary"),
    ],
    ids=lambda variant: variant.name,
)
def test_its_table_has_a_line_for_each_rule_and_fits_80_columns(variant: Variant) -> None:
    outcome = plan().run(variant, 1)
    file = io.StringIO()
    _show(rows([outcome], [variant]), Console(file=file, width=80))
    lines = file.getvalue().splitlines()
    assert max(map(len, lines)) <= 80
    assert outcome.result is not None
    for rule, margin in (outcome.result.min_margin or {}).items():
        assert any(rule in line and f"{margin:.3f}" in line for line in lines)
    # Its name goes on beside the next rule, and is broken where a reader would.
    shown = " ".join(re.findall(rf"^(.*) (?:{'|'.join(RULES)}) +\d", file.getvalue(), re.MULTILINE))
    assert re.findall(r"[^\s-]+", shown) == re.findall(r"[^\s-]+", variant.name)


def test_an_ill_formed_variant_is_refused_or_forced_and_marked() -> None:
    variant = named("Delta of collision", "1 s, mission")
    refused = plan().run(variant, 1)
    assert refused.result is None
    assert refused.refusal is not None
    assert "module 'collision' is ill-formed (P3)" in refused.refusal.text
    forced = plan(force=True).run(variant, 1)
    assert forced.result is not None
    would_do = "Delta = 0.35 s would do for collision"
    assert [row.cells(None)[-1] for row in rows([refused], [variant])] == [f"refused (P3): {would_do}"]
    assert [row.cells(None)[-1] for row in rows([forced], [variant])] == [f"forced (P3): {would_do}"]


def test_variants_refused_for_the_same_reason_share_a_line_below_the_table() -> None:
    chosen = [
        *(variant for variant in variants() if variant.group == "Delta of geofence"),
        named("phi_safer of collision", "0.4"),
    ]
    file = io.StringIO()
    _show(rows([plan().run(variant, 1) for variant in chosen], chosen), Console(file=file, width=80))
    table, _, below = file.getvalue().partition("refused (P3): ")
    assert re.findall(r"^ +4 s, mission +refused +\(P3\)", table, re.MULTILINE)
    assert below.splitlines() == [
        "Delta = 0.1 s would do for geofence",
        "refused (P3): a phi_safer whose edge has a margin of 0.115 m would do for collision",
        "--json FILE has the reasons in full.",
    ]


def test_a_forced_variant_is_marked_in_the_table() -> None:
    variant = named("Delta of obstacle", "0.5 s, adversary:fastest-to-boundary")
    file = io.StringIO()
    _show(rows([plan(force=True).run(variant, 1)], [variant]), Console(file=file, width=80))
    assert re.search(r"^ +forced \(P3\) +obstacle ", file.getvalue(), re.MULTILINE)


def test_what_a_mission_cannot_be_is_refused_too() -> None:
    outcome = plan().run(Variant("x", "y", {"rta.collision.delta_s": 0.07}), 1)
    assert outcome.refusal is not None
    assert "a multiple of base_tick_s" in outcome.refusal.text
    assert rows([outcome], [outcome.variant])[0].mark == "refused"


def test_a_variant_that_fails_says_so() -> None:
    outcome = plan(backend="nowhere").run(Variant("x", "y"), 1)
    assert "nowhere" in outcome.failure
    assert rows([outcome], [outcome.variant])[0].cells(None)[-1].startswith("FAILED: ")


def test_less_than_one_delta_ahead_breaks_the_rules_that_two_keep() -> None:
    # With a Delta of one base tick there is hardly anything that less than one could miss.
    seldom = {"rta.collision.delta_s": 0.1, "rta.geofence.delta_s": 0.5, "rta.geofence.phi_safer_inset_m": 0.5}

    def violations(deltas: float) -> int:
        variant = named("look-ahead", f"{deltas:g} Delta, adversary:search")
        total = 0
        for seed in (1, 2, 3):
            result = plan(duration_s=100.0, **seldom).run(variant, seed).result
            assert result is not None
            assert result.violations is not None
            total += sum(result.violations.values())
        return total

    assert violations(2.0) == 0
    assert violations(0.0) > 0


def test_phi_safer_alone_keeps_the_rule_only_if_it_is_well_formed() -> None:
    def collisions(delta_s: float) -> int:
        variant = named("phi_safer alone", f"collision {delta_s:g} s, chase")
        result = plan(duration_s=200.0, force=True).run(variant, 1).result
        assert result is not None
        assert result.violations is not None
        return result.violations["collision"]

    assert collisions(0.1) == 0
    assert collisions(2.0) > 0


def test_studies_are_for_virtual_time_only(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = load_backend("kinematic").robot_class
    monkeypatch.setattr(robot, "declared", replace(robot.declared, in_process=False))
    with pytest.raises(ConfigError, match="studies run in virtual time only"):
        run_mission(load_mission(MISSION, QUICK), study=Study(deltas=1.0))


def test_a_broken_promise_is_told_from_what_was_to_be_expected(result: RunResult) -> None:
    broken = result.model_copy(update={"violations": {"battery": 0, "geofence": 1, "collision": 0, "obstacle": 0}})
    assert VariantRun(Variant("mission", "as declared"), 1, broken).breaks_promise
    assert not VariantRun(Variant("mission", "AC only", intact=False), 1, broken).breaks_promise
    assert not VariantRun(Variant("mission", "as declared"), 1, broken, VariantRefusal("", "P3", "")).breaks_promise
    found = rows([VariantRun(Variant("mission", "as declared"), 1, broken)], [Variant("mission", "as declared")])
    assert found[0].cells(None)[-1] == "BREAKS ITS PROMISE"


def test_throughput_is_compared_with_that_of_the_ac_alone(result: RunResult) -> None:
    alone = Variant("mission", "AC only (no RTA)", {"rta.enabled": False}, intact=False)
    declared = Variant("mission", "as declared")
    outcomes = [
        VariantRun(declared, 1, result.model_copy(update={"targets_reached": 5})),
        VariantRun(alone, 1, result.model_copy(update={"targets_reached": 10})),
    ]
    found = rows(outcomes, [declared, alone])
    compared = ac_only(found)
    assert [row.cells(compared)[HEAD.index("of AC only")] for row in found] == ["50%", "100%"]
    text = markdown(found, "soter ablate x.toml")
    assert "## Mission" in text
    assert "soter ablate x.toml" in text


def test_nothing_run_is_a_page_too() -> None:
    assert "Nothing was run." in markdown([], "soter ablate x.toml")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--only", "nothing*"), "no variant matches 'nothing*'"),
        (("--seeds", "1,one"), "--seeds: it is '1,one', allowed: whole numbers"),
        (("--seeds", "1,1"), "allowed: each seed once"),
        (("--seeds", ""), "--seeds: it is '', allowed"),
        (("--duration", "-1"), "duration_s: it is -1.0"),
        (("--targets", "gird"), "did you mean 'grid'?"),
        (("--set", "targets='grid'"), "targets: it is given twice"),
        (("--markdown", "/no/such/folder/page.md"), "--markdown: '/no/such/folder/page.md' cannot be written"),
        (("--json", "/no/such/folder/all.json"), "--json"),
        (("--backend", "nowhere"), "unknown backend 'nowhere'"),
        (("--backend", "mavlink"), "backend: it is 'mavlink', allowed: a backend in virtual time"),
    ],
)
def test_bad_input_runs_nothing(arguments: tuple[str, ...], message: str) -> None:
    done = ablated("--only", "mission", *arguments) if "--only" not in arguments else ablated(*arguments)
    assert done.exit_code == 2
    assert message in done.stderr


def test_variants_are_listed() -> None:
    done = ablated("--list", "--only", "dwell")
    assert done.exit_code == 0
    assert done.stdout.split("\n")[:2] == ["dwell/0 s", "dwell/0.3 s"]


def test_ctrl_c_ends_it_and_writes_what_is_finished(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    command = [
        sys.executable, "-m", "soter.cli", "ablate", str(MISSION), "--only", "mission", "--duration", "1e6",
        "--seeds", "1", "--markdown", str(page),
    ]  # fmt: skip
    with subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True
    ) as process:
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
        deadline_s = time.monotonic() + 30.0
        # Workers are started once the signal is taken care of.
        while not children.read_text() and time.monotonic() < deadline_s:
            time.sleep(0.05)
        os.killpg(process.pid, signal.SIGINT)
        _, said = process.communicate(timeout=60.0)
    assert process.returncode == 130, said
    assert "Nothing was run." in page.read_text()


def dies(plan: Plan, variant: Variant, seed: int) -> VariantRun:
    """What a worker does that runs out of memory."""
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError("unreachable")


def test_a_worker_that_dies_is_a_failed_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ablate, "_work", dies)
    with pytest.raises(RunFailed, match="has died"):
        list(ablate.run_all(plan(), [Variant("mission", "as declared")], 1))


@pytest.mark.parametrize("stopped", [True, False])
def test_a_worker_that_dies_while_others_begin_is_a_failure_unless_ctrl_c_has_killed_it(
    monkeypatch: pytest.MonkeyPatch, stopped: bool
) -> None:
    def broken(*_: object) -> None:
        raise BrokenProcessPool("not usable any more")

    monkeypatch.setattr(ProcessPoolExecutor, "submit", broken)
    runs = ablate.run_all(plan(), [Variant("mission", "as declared")], 1, lambda: stopped)
    if stopped:
        assert list(runs) == []
        return
    with pytest.raises(RunFailed, match="has died"):
        list(runs)


def test_a_module_of_the_users_own_is_left_out_by_name(tmp_path: Path) -> None:
    zone = MISSION.parent / "modules" / "zone.toml"
    page = tmp_path / "page.md"
    words = ("--only", "without a module/zone-speed", "--duration", "120", "--seeds", "1", "--markdown", str(page))
    done = CliRunner().invoke(app, ["ablate", str(zone), *words])
    assert done.exit_code == 0, done.output
    found = re.search(r"/ zone-speed (\d+)", page.read_text())
    assert found is not None
    assert int(found[1]) > 0, "its rule breaks"
