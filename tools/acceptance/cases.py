"""The runs that the evaluation consists of; each is one command line."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from typing import Final

TWO_HOURS_S: Final = 7200.0
SHORT_S: Final = 60.0
MODULES: Final = ("collision", "obstacle", "geofence", "battery")
TARGETS: Final = ("grid", "uniform", "hostile")
SEEDS: Final = (1, 2, 3, 4)
PYBULLET_SEEDS: Final = (1, 2)
PLANNERS: Final = {
    "Raises": "raises an exception",
    "Garbage": "returns garbage",
    "Slow": "takes longer than the ten seconds it has",
    "NeverReturns": "never returns",
}
"""What the planners of `tools.acceptance.planners` do to robot 1."""

SURVEILLANCE: Final = "examples/surveillance.toml"
# The example begins with an almost empty battery, so that a short run shows it charge. Here the seed draws all charges.
CHARGE_FROM_SEED: Final = ("--set", "battery.initial={}")
# What the thesis says, as far as it is well-formed: its own 0.5 s for collisions is not. The example has less.
THESIS_NUMBERS: Final = (
    "--set", "rta.collision.delta_s=0.1", "--set", "rta.collision.phi_safer_m=0.5",
    "--set", "rta.geofence.delta_s=0.5", "--set", "rta.geofence.phi_safer_inset_m=0.5",
)  # fmt: skip
WAREHOUSE: Final = "examples/warehouse.toml"


@dataclass(frozen=True, slots=True)
class Case:
    """One run.

    Attributes:
        name: names it in files and for `--only`.
        group: `protected`, `unprotected`, `without`, `repeated` or `planner`; or one of `tools.acceptance.adversaries`.
        mission: the mission file.
        options: what the command line says besides.
        duration_s: simulated time.
        engine: `kinematic` or `pybullet`.
        subject: what the group varies: the set of targets, the module left out, the planner, the adversary.
        loaded: the machine is kept busy while it runs.
        repeats: name of the case whose run this one must repeat bit for bit.
    """

    name: str
    group: str
    mission: str
    options: tuple[str, ...]
    duration_s: float
    engine: str
    subject: str
    seed: int
    loaded: bool = False
    repeats: str = ""

    def arguments(self, scale: float = 1.0) -> list[str]:
        """Return the arguments of `soter`; `scale` shortens the run."""
        duration = f"{self.duration_s * scale:.10g}"
        return ["run", self.mission, *self.options, "--seed", str(self.seed), "--duration", duration, "--no-record"]

    def command(self, scale: float = 1.0) -> str:
        """Return the command line that repeats this run."""
        return shlex.join(["soter", *self.arguments(scale)])


def _case(
    group: str, engine: str, subject: str, seed: int, *more: str, mission: str = SURVEILLANCE,
    duration_s: float = TWO_HOURS_S, loaded: bool = False, repeats: str = "",
) -> Case:  # fmt: skip
    name = f"{group}-{subject}-{engine}-{seed}".replace("_", "-").lower()
    numbers = (*CHARGE_FROM_SEED, *THESIS_NUMBERS) if mission == SURVEILLANCE else ()
    return Case(
        name, group, mission, ("--backend", engine, *more, *numbers), duration_s, engine, subject, seed, loaded, repeats
    )


def all_cases() -> list[Case]:
    """Return every run of the evaluation; those that others repeat stand before them."""
    cases = [
        _case("protected", engine, targets, seed, "--targets", targets)
        for engine, seeds in (("kinematic", SEEDS), ("pybullet", PYBULLET_SEEDS))
        for targets in TARGETS
        for seed in seeds
    ]
    cases += [_case("protected", "kinematic", "warehouse", seed, mission=WAREHOUSE) for seed in SEEDS]
    cases.append(_case("protected", "pybullet", "warehouse", SEEDS[0], mission=WAREHOUSE))
    hostile = ("--targets", "hostile")
    cases += [_case("unprotected", "kinematic", "hostile", seed, *hostile, "--no-rta") for seed in SEEDS]
    for left_out in MODULES:
        rest = ",".join(name for name in MODULES if name != left_out)
        cases += [_case("without", "kinematic", left_out, seed, *hostile, "--modules", rest) for seed in SEEDS]
    cases += [
        _case(
            "repeated", engine, "grid", SEEDS[0], "--targets", "grid", loaded=True,
            repeats=f"protected-grid-{engine}-{SEEDS[0]}",
        )
        for engine in ("kinematic", "pybullet")
    ]  # fmt: skip
    cases += [
        _case(
            "planner", "kinematic", planner, SEEDS[0], "--targets", "uniform",
            "--planner", f"tools.acceptance.planners:{planner}", duration_s=SHORT_S,
        )
        for planner in PLANNERS
    ]  # fmt: skip
    return cases
