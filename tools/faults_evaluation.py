"""The table of docs/faults.md: the surveillance mission under every fault, within its declared bounds and beyond.

    python tools/faults_evaluation.py [--jobs N] [--only PATTERN] [--duration SECONDS]

Each fault runs on the kinematic engine for 30 simulated minutes with three seeds, within bounds with two sets of
targets, judged by ground truth. With all of them run, the tables go into the page. A violation within declared bounds
is an exit code of 1: then a module's promise does not hold.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path
from typing import Any, Final

from soter.config import load_mission
from soter.faults import read_faults
from soter.faults.robot import widened
from soter.registry import load_backend
from soter.runner import RunResult, run_mission
from soter.sdk import RULES
from soter.stack.declaration import timing_of

ROOT: Final = Path(__file__).resolve().parents[1]
MISSION: Final = ROOT / "examples" / "surveillance.toml"
PAGE: Final = ROOT / "docs" / "faults.md"
BACKEND: Final = "kinematic"
DURATION_S: Final = 1800.0
SEEDS: Final = (1, 2, 3)
TARGETS: Final = ("grid", "hostile")
"""Sets of targets for faults within bounds; beyond them, the last one only."""
BEGIN: Final = "<!-- Begin of what `python tools/faults_evaluation.py` writes. -->"
END: Final = "<!-- End of what `python tools/faults_evaluation.py` writes. -->"

Table = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Case:
    """One set of faults.

    Attributes:
        name: for `--only`.
        within: whether all of them keep within what is declared.
        tables: the `[[fault]]` tables.
        wider: whether phi_safer pays for positions that are wrong by 5 cm (`WIDER`).
    """

    name: str
    within: bool
    tables: tuple[Table, ...]
    wider: bool = False


def _within(name: str, *tables: Table, wider: bool = False) -> Case:
    return Case(name, True, tables, wider)


def _beyond(name: str, *tables: Table) -> Case:
    return Case(name, False, tuple({**table, "declared": False} for table in tables))


WIDER: Final = {
    "rta.collision.phi_safer_m": 0.6, "rta.obstacle.phi_safer_m": 0.15, "rta.geofence.phi_safer_inset_m": 0.15,
}  # fmt: skip
AGAIN: Final = {"start_s": 20.0, "duration_s": 10.0, "every_s": 20.0}
CASES: Final = (
    _within("none"),
    _within("delay-commands", {"kind": "delay", "commands_s": 0.09}),
    _within("delay-samples", {"kind": "delay", "samples_s": 0.05}),
    _within("delay-both", {"kind": "delay", "commands_s": 0.03, "samples_s": 0.05}),
    _within("delay-jitter", {"kind": "delay", "commands_s": 0.02, "jitter_s": 0.07}),
    _within("loss-commands", {"kind": "loss", "commands": 0.2}),
    _within("loss-samples", {"kind": "loss", "samples": 0.2}),
    _within("duplicate", {"kind": "duplicate", "commands": 0.2, "samples": 0.2, "after_s": 0.04}),
    _within("freeze", {"kind": "freeze", "duration_s": 0.05, "every_s": 0.5}),
    _within("freeze-restamped", {"kind": "freeze", "duration_s": 0.2, "every_s": 1.0, "restamped": True}, wider=True),
    _within(
        "bias",
        {"kind": "bias", "x_m": 0.04, "y_m": -0.03, "robot": 1},
        {"kind": "bias", "x_m": -0.05, "robot": 2},
        wider=True,
    ),
    _within("bias-heading", {"kind": "bias", "heading_rad": 0.5}),
    _within("clock-back", {"kind": "clock_step", "step_s": -0.05, **AGAIN}, wider=True),
    _within("clock-ahead", {"kind": "clock_step", "step_s": 0.05, **AGAIN}, wider=True),
    _within("battery-low", {"kind": "battery", "offset": -0.1}),
    _within("wheel-slip", {"kind": "wheel_slip", "left": 0.8, "right": 0.85}),
    _within("weak-brakes", {"kind": "weak_brakes", "factor": 0.6}),
    _within("kill", {"kind": "kill", "robot": 1, "start_s": 60.0, "duration_s": 30.0, "every_s": 120.0}),
    _within("kill-both", {"kind": "kill", "start_s": 60.0, "duration_s": 30.0, "every_s": 120.0}),
    _within(
        "several",
        {"kind": "delay", "samples_s": 0.05},
        {"kind": "bias", "x_m": 0.02},
        {"kind": "weak_brakes", "factor": 0.9},
        {"kind": "battery", "offset": -0.05},
        wider=True,
    ),
    _beyond("delay-commands-beyond", {"kind": "delay", "commands_s": 0.5}),
    _beyond("delay-samples-beyond", {"kind": "delay", "samples_s": 0.5}),
    _beyond("loss-commands-beyond", {"kind": "loss", "commands": 0.3, "burst": 0, "resend": False}),
    _beyond("loss-samples-beyond", {"kind": "loss", "samples": 0.2, "burst": 0}),
    _beyond(
        "cut",
        {
            "kind": "loss",
            "commands": 1.0,
            "samples": 1.0,
            "burst": 0,
            "start_s": 60.0,
            "duration_s": 10.0,
            "every_s": 60.0,
        },
    ),
    _beyond("duplicate-beyond", {"kind": "duplicate", "commands": 0.3, "after_s": 0.5, "reorder": True}),
    _beyond("freeze-beyond", {"kind": "freeze", "duration_s": 2.0, "every_s": 20.0}),
    _beyond("freeze-restamped-beyond", {"kind": "freeze", "duration_s": 2.0, "every_s": 20.0, "restamped": True}),
    _beyond("bias-beyond", {"kind": "bias", "x_m": 0.3, "robot": 1}),
    _beyond("clock-back-beyond", {"kind": "clock_step", "step_s": -0.5, **AGAIN}),
    _beyond("clock-ahead-beyond", {"kind": "clock_step", "step_s": 10.0, **AGAIN}),
    _beyond("battery-high", {"kind": "battery", "offset": 0.15}),
    _beyond("wheel-slip-beyond", {"kind": "wheel_slip", "left": 0.5}),
    _beyond("weak-brakes-beyond", {"kind": "weak_brakes", "factor": 0.2}),
    _beyond("kill-for-good", {"kind": "kill", "robot": 1, "start_s": 60.0}),
)


def run_one(case: Case, targets: str, seed: int, duration_s: float) -> RunResult:
    """Run the mission once."""
    overrides = {
        "backend": BACKEND, "targets": targets, "seed": seed, "duration_s": duration_s,
        "fault": [dict(table) for table in case.tables], **(WIDER if case.wider else {}),
    }  # fmt: skip
    return run_mission(load_mission(MISSION, overrides)).result


def horizon_s(case: Case) -> float:
    """Return the horizon of the collision module on robot 1 under the case's faults."""
    mission = load_mission(MISSION, {"fault": [dict(table) for table in case.tables]})
    faults = [table.made_for(1, 0, mission.base_tick_s) for table in read_faults(mission, [1, 2]) if table.hits(1)]
    promised = widened(load_backend(BACKEND).robot_class.declared, faults)
    ahead_s = timing_of(promised, mission.base_tick_s).ahead_s(mission.rta.collision.delta_s)
    return ahead_s + promised.latency_s + promised.sample_age_s + promised.jitter_s


def shown(table: Table) -> str:
    """Return a table as one line; what stands in every one of its group is left out."""
    values = {key: value for key, value in table.items() if key not in ("kind", "declared")}
    texts = [f"{key} {value if value is not True else ''}".strip() for key, value in values.items()]
    return f"{table['kind']} ({', '.join(texts)})" if texts else str(table["kind"])


def row(case: Case, results: Sequence[RunResult]) -> list[str]:
    """Return the case's line of the table."""
    violations = [sum((r.violations or {}).get(rule, 0) for r in results) for rule in RULES]
    least = [min((r.min_margin or {}).get(rule, 0.0) for r in results) for rule in RULES]
    hours = sum(r.duration_s * r.robots for r in results) / 3600.0
    alarms = sum(r.disengagements.get("supervisor", 0) for r in results)
    return [
        ("; ".join(map(shown, case.tables)) or "none") + (" (wider)" if case.wider else ""),
        f"{horizon_s(case):.2f}",
        " / ".join(map(str, violations)),
        " / ".join(f"{margin:.2f}" for margin in least),
        f"{100.0 * sum(r.ac_share for r in results) / len(results):.0f}",
        f"{sum(r.disengagements_total for r in results) / hours:.0f}",
        f"{alarms / hours:.0f}",
        f"{sum(r.targets_reached for r in results) / hours:.0f}",
        f"{max(r.longest_stall_s for r in results):.0f}",
    ]


def tables_of(found: Mapping[str, Sequence[RunResult]], duration_s: float) -> str:
    """Return both tables as Markdown."""
    intro = (
        f"Each line: {len(SEEDS)} seeds x {duration_s / 60.0:g} simulated minutes x {' and '.join(TARGETS)} targets "
        f"(beyond the bounds {TARGETS[-1]} ones only), two robots, on the {BACKEND} engine. Violations and least "
        f"margins are those of ground truth: {' / '.join(RULES)}. H is the collision module's horizon. Alarms are "
        "disengagements because an assumption failed that the supervisor watches. Where it says wider, phi_safer "
        "pays for positions that are wrong by 5 cm: 0.6 m of distance, 0.15 m of clearance and an inset of 0.15 m, "
        "not 0.5, 0.1 and 0.1 m."
    )
    lines = [intro, ""]
    head = [
        "fault", "H, s", "violations", "least margins", "AC, %", "disengagements per robot-hour",
        "alarms per robot-hour", "reached per robot-hour", "longest stall, s",
    ]  # fmt: skip
    for within, title in ((True, "Within declared bounds"), (False, "Beyond declared bounds: the stack is not told")):
        rows = [row(case, found[case.name]) for case in CASES if case.within is within and case.name in found]
        lines += [f"### {title}", "", *_markdown(head, rows), ""]
    return "\n".join(lines).rstrip()


def _markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    return [f"| {' | '.join(line)} |" for line in (head, ["---", *["--:"] * (len(head) - 1)], *rows)]


def write(page: Path, generated: str) -> None:
    """Put the tables between the page's markers.

    Raises:
        ValueError: the page has lost its markers.
    """
    before, begin, rest = page.read_text(encoding="utf-8").partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"{page} has lost the lines '{BEGIN}' and '{END}', between which its tables go")
    page.write_text(f"{before}{begin}\n\n{generated}\n\n{end}{after}", encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the evaluation; return 1 if a rule was broken within declared bounds."""
    parser = argparse.ArgumentParser(description="Runs the surveillance mission under every fault.")
    parser.add_argument("--jobs", type=int, default=1, help="runs at a time")
    parser.add_argument("--only", default="*", help="cases whose names match this pattern; the page stays as it is")
    parser.add_argument("--duration", type=float, default=DURATION_S, help="simulated seconds of each run")
    options = parser.parse_args(arguments)
    found: dict[str, list[RunResult]] = {}
    broken = []
    with ProcessPoolExecutor(options.jobs) as pool:
        chosen = [case for case in CASES if fnmatch(case.name, options.only)]
        waiting = [
            [
                pool.submit(run_one, case, targets, seed, options.duration)
                for targets in (TARGETS if case.within else TARGETS[-1:])
                for seed in SEEDS
            ]
            for case in chosen
        ]
        for case, futures in zip(chosen, waiting, strict=True):
            results = found[case.name] = [future.result() for future in futures]
            cells = row(case, results)
            print(f"{case.name:24} {' | '.join(cells[1:])}", flush=True)
            if case.within and any(result.violated for result in results):
                broken.append(case.name)
    if options.only == "*" and options.duration == DURATION_S:
        write(PAGE, tables_of(found, options.duration))
    if broken:
        print(f"within declared bounds, but a rule was broken: {', '.join(broken)}", file=sys.stderr)
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
