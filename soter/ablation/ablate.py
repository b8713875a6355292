"""Measures the worth of each part of the safety modules: runs the same mission with one thing changed at a time."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Final, Self

from soter.config import load_mission
from soter.config.tables import MODULES
from soter.controllers import ADVERSARIES, PREFIX
from soter.errors import ConfigError, IllFormedModule, RunFailed, SoterError
from soter.runner import Follower, Study, run_mission
from soter.runner.result import RunResult

DELTAS_S: Final[Mapping[str, tuple[float, ...]]] = {
    "collision": (0.05, 0.1, 0.2, 0.5, 1.0),
    "obstacle": (0.05, 0.1, 0.2, 0.5, 1.0),
    "geofence": (0.05, 0.25, 0.5, 1.0, 2.0, 4.0),
    "battery": (0.5, 1.0, 10.0, 60.0),
}
"""By module, values of Delta to try."""

ATTACKERS: Final[Mapping[str, str]] = {
    "collision": "chase",
    "obstacle": "fastest-to-boundary",
    "geofence": "fastest-to-boundary",
}
"""By module, the adversary that shows when Delta is too long; none for the battery, which takes hours to run flat."""

SAFER: Final[Mapping[str, tuple[str, tuple[float, ...]]]] = {
    "collision": ("phi_safer_m", (0.4, 0.46, 0.5, 0.6, 0.7)),
    "obstacle": ("phi_safer_m", (0.03, 0.06, 0.1, 0.2)),
    "geofence": ("phi_safer_inset_m", (0.1, 0.26, 0.5, 1.0)),
    "battery": ("phi_safer", (0.5, 0.7, 0.85, 0.95)),
}
"""By module, the key of its phi_safer and values to try."""

DWELLS_S: Final = (0.0, 0.3, 1.0, 3.0)

ALONE_S: Final[Mapping[str, tuple[float, ...]]] = {
    "collision": (0.1, 1.0, 2.0),
    "obstacle": (0.05, 1.0, 2.0),
    "geofence": (0.5, 2.0, 4.0),
}
"""By module, values of Delta to try if phi_safer alone decides whether the AC gets control."""

AHEAD: Final = (2.0, 1.0, 0.5, 0.0)
"""How many Delta the switching test looks ahead, regardless of the lease."""

_POLL_S: Final = 0.2

Overrides = Mapping[str, object]


@dataclass(frozen=True)
class Variant:
    """The mission with one thing changed.

    Attributes:
        group: the thing that is changed.
        name: the change.
        overrides: values that replace the mission's, by dotted key.
        deltas: how many Delta the modules look ahead; None for what proofs need.
        safer_alone: whether modules give control back wherever phi_safer holds.
        intact: whether all modules are kept, so that no rule may be broken unless the variant is ill-formed.
    """

    group: str
    name: str
    overrides: Overrides = field(default_factory=dict)
    deltas: float | None = None
    safer_alone: bool = False
    intact: bool = True


@dataclass(frozen=True)
class VariantRefusal:
    """Why a variant is ill-formed.

    Attributes:
        text: all of it.
        condition: the condition that fails, such as "P3"; empty for what no mission can be.
        remedy: what would do, in few words; the text where there are none.
    """

    text: str
    condition: str
    remedy: str

    @classmethod
    def of(cls, failure: IllFormedModule | ConfigError) -> Self:
        """Return a refusal that can be sent to another process, which the exception cannot."""
        text = str(failure)
        if isinstance(failure, ConfigError):
            return cls(text, "", text)
        remedy = f"{failure.remedy} would do for {failure.module}" if failure.remedy else text
        return cls(text, failure.condition, remedy)


@dataclass(frozen=True)
class VariantRun:
    """One run of a variant, or why there was none.

    Attributes:
        result: the figures; None if nothing was run.
        refusal: why the variant is refused, or would be if it were not forced; None for a well-formed one.
        failure: why there is no result although it is not refused; empty if there is one.
    """

    variant: Variant
    seed: int
    result: RunResult | None = None
    refusal: VariantRefusal | None = None
    failure: str = ""

    @property
    def breaks_promise(self) -> bool:
        """Whether a rule was broken that the declared modules promise to keep."""
        intact = self.variant.intact and self.refusal is None
        return intact and self.result is not None and self.result.violated


def variants(own: Iterable[str] = ()) -> list[Variant]:
    """Return all variants, the unchanged mission first; `own` are the names of its user-made modules."""
    found = [
        Variant("mission", "as declared"),
        Variant("mission", "AC only (no RTA)", {"rta.enabled": False}, intact=False),
        Variant("mission", "SC only", {"ac": f"{PREFIX}raises"}),
    ]
    for left_out in MODULES:
        rest = [name for name in MODULES if name != left_out]
        found.append(Variant("without a module", left_out, {"rta.modules": rest}, intact=False))
    for left_out in own:
        off = {f"rta.module.{left_out}.enabled": False}
        found.append(Variant("without a module", left_out, off, intact=False))
    for module, deltas_s in DELTAS_S.items():
        for ac in ("mission", *(f"{PREFIX}{name}" for rule, name in ATTACKERS.items() if rule == module)):
            found += [
                Variant(f"Delta of {module}", f"{delta_s:g} s, {ac}", {f"rta.{module}.delta_s": delta_s, "ac": ac})
                for delta_s in deltas_s
            ]
    for ac in ("mission", f"{PREFIX}search"):
        found += [
            Variant("look-ahead", f"{deltas:g} Delta, {ac}", {"ac": ac}, deltas, intact=deltas >= 2.0)
            for deltas in AHEAD
        ]
    for module, attacker in ATTACKERS.items():
        found += [
            Variant(
                "phi_safer alone", f"{module} {delta_s:g} s, {attacker}",
                {f"rta.{module}.delta_s": delta_s, "ac": f"{PREFIX}{attacker}"}, safer_alone=True, intact=False,
            )
            for delta_s in ALONE_S[module]
        ]  # fmt: skip
    for module, (key, values) in SAFER.items():
        found += [Variant(f"phi_safer of {module}", f"{value:g}", {f"rta.{module}.{key}": value}) for value in values]
    found += [
        Variant("dwell", f"{dwell_s:g} s", {f"rta.{module}.dwell_s": dwell_s for module in MODULES})
        for dwell_s in DWELLS_S
    ]
    return found + [Variant("adversary", name, {"ac": f"{PREFIX}{name}"}) for name in ADVERSARIES]


@dataclass(frozen=True)
class Plan:
    """The mission and settings of all runs.

    Attributes:
        overrides: the command line's settings; a variant's own override them.
        seeds: the seeds; each variant runs once with each.
        force: whether ill-formed variants run all the same.
    """

    mission: Path
    overrides: Overrides
    seeds: Sequence[int]
    force: bool

    def run(self, variant: Variant, seed: int, stop: Callable[[], bool] = lambda: False) -> VariantRun:
        """Run one variant once. Errors become part of the outcome."""
        forced: list[IllFormedModule] = []
        try:
            mission = load_mission(self.mission, {**self.overrides, **variant.overrides, "seed": seed})
            study = Study(variant.deltas, variant.safer_alone, forced.append if self.force else None)
            result = run_mission(mission, follower=Follower(stop=stop), study=study).result
        except (IllFormedModule, ConfigError) as refusal:
            return VariantRun(variant, seed, refusal=VariantRefusal.of(refusal))
        except SoterError as error:
            return VariantRun(variant, seed, failure=str(error))
        failure = result.failure if result.status == "failed" else ""
        return VariantRun(variant, seed, result, VariantRefusal.of(forced[0]) if forced else None, failure)


_stop: Event | None = None


def _begin(stop: Event) -> None:
    """Prepare a worker process, which ignores Ctrl-C: the first process sets `stop` for it."""
    global _stop
    _stop = stop
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _work(plan: Plan, variant: Variant, seed: int) -> VariantRun:
    return plan.run(variant, seed, lambda: _stop is not None and _stop.is_set())


def run_all(
    plan: Plan, chosen: Sequence[Variant], jobs: int, stop: Callable[[], bool] = lambda: False
) -> Iterator[VariantRun]:
    """Run variants in `jobs` processes; yield outcomes as they come. Once `stop` returns True, runs end early.

    Raises:
        RunFailed: a process died.
    """
    context = multiprocessing.get_context("spawn")
    ended = context.Event()
    with ProcessPoolExecutor(jobs, context, _begin, (ended,)) as pool:
        try:
            waiting: set[Future[VariantRun]] = {
                pool.submit(_work, plan, variant, seed) for variant in chosen for seed in plan.seeds
            }
            while waiting and not stop():
                done, waiting = wait(waiting, _POLL_S, FIRST_COMPLETED)
                for future in done:
                    yield future.result()
        except BrokenProcessPool as death:
            # Ctrl-C also reaches workers, and those that have just begun do not ignore it yet.
            if not stop():
                raise RunFailed("a process of variants has died; the machine may have run out of memory") from death
        finally:
            ended.set()
            pool.shutdown(cancel_futures=True)
