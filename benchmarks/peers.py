"""What a decision costs here and in two other libraries, in one process and in turns.

The same samples go to a geofence decision of SOTER and to an explicit simplex filter of run-time-assurance (JAX, on the
CPU, compiled): four sides, a prediction over one Delta, the way that is left for latency and braking. The same margins
go to SOTER's spec monitor and to an online monitor of rtamt for `always[0,1](margin >= 0)`, twenty samples long. All
of it stays safe, so that nobody's backup controller is timed. `make bench-peers` runs it in an environment of its own.
"""

from __future__ import annotations

import importlib
import statistics
import sys
import time
from collections import OrderedDict
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from benchmarks.common import Row, arguments, in_turns, show
from benchmarks.decision import bound_modules, median_us, reference, situations
from soter.geometry.workspace import Workspace
from soter.rta import DecisionModule, ModuleMonitor, Situation
from soter.sdk import Controller

TICK_S = 0.05
LOOK_S = 0.5
GEOFENCE = "geofence"


def imported(*names: str) -> list[Any]:
    """Return modules of the other libraries.

    Raises:
        SystemExit: one of them is not installed here; the message says how to run this.
    """
    try:
        return [importlib.import_module(name) for name in names]
    except ImportError as missing:
        raise SystemExit(
            f"{missing}: the other libraries have an environment of their own; run: make bench-peers"
        ) from (missing)


def simplex_filter(workspace: Workspace, left_m: float) -> Any:
    """Return an explicit simplex filter for the state x, y, vx, vy that keeps `left_m` from every side of the fence."""
    rta, constraint, controller, jax, jnp = imported(
        "run_time_assurance.rta",
        "run_time_assurance.constraint",
        "run_time_assurance.controller",
        "jax",
        "jax.numpy",
    )
    jax.config.update("jax_platforms", "cpu")
    one_constraint: Any = constraint.ConstraintModule
    one_controller: Any = controller.RTABackupController
    explicit_simplex: Any = rta.ExplicitSimplexModule

    class Side(one_constraint):  # type: ignore[misc] # the library is not typed
        def __init__(self, sign: float, axis: int, edge_m: float) -> None:
            self.sign, self.axis, self.edge_m = sign, axis, edge_m
            super().__init__()

        def _compute(self, state: Any, params: dict[str, Any]) -> Any:
            return self.sign * (state[self.axis] - self.edge_m) - left_m

    class Brake(one_controller):  # type: ignore[misc] # the library is not typed
        def _generate_control(self, state: Any, step_size: float, controller_state: Any = None) -> tuple[Any, None]:
            return -state[2:] / step_size, None

    class Filter(explicit_simplex):  # type: ignore[misc] # the library is not typed
        def _setup_constraints(self) -> OrderedDict[str, Any]:
            return OrderedDict(
                west=Side(1.0, 0, 0.0),
                east=Side(-1.0, 0, workspace.width_m),
                south=Side(1.0, 1, 0.0),
                north=Side(-1.0, 1, workspace.depth_m),
            )

        def _pred_state(self, state: Any, step_size: float, control: Any) -> Any:
            return jnp.concatenate([state[:2] + state[2:] * step_size, state[2:] + control * step_size])

    return Filter(
        backup_controller=Brake(),
        control_bounds_high=1.0,
        control_bounds_low=-1.0,
        # Everything that this library can compile is compiled.
        jit_compile_dict={"constraint_violation": True, "pred_state": True},
    )


def stl_monitor() -> Any:
    """Return an online monitor for margins that stay at 0 or above for a second, sampled every tick."""
    (rtamt,) = imported("rtamt")
    spec = rtamt.StlDiscreteTimeOnlineSpecification()
    spec.declare_var("margin", "float")
    spec.spec = "always[0,1](margin >= 0)"
    spec.set_sampling_period(round(TICK_S * 1000), "ms", 0.1)
    spec.parse()
    spec.pastify()
    return spec


def filter_calls(
    simplex: Any, views: Sequence[Situation]
) -> tuple[Callable[[Situation], bool], Callable[[Situation], bool]]:
    """Return the filter's whole call, and its monitor alone on states that JAX has already: is it safe?"""
    np, jnp = imported("numpy", "jax.numpy")
    control = np.zeros(2)
    states = {id(view): np.array([view.own.x_m, view.own.y_m, view.own.vx_m_s, view.own.vy_m_s]) for view in views}
    inside = {key: jnp.asarray(state) for key, state in states.items()}
    control_inside = jnp.asarray(control)

    def whole(view: Situation) -> bool:
        simplex.filter_control(states[id(view)], LOOK_S, control)
        return not simplex.intervening

    def monitor(view: Situation) -> bool:
        return not simplex.monitor(inside[id(view)], LOOK_S, control_inside)

    return whole, monitor


def spec_calls(
    geofence: DecisionModule, views: Sequence[Situation]
) -> tuple[Callable[[Situation], object], Callable[[Situation], object]]:
    """Return one look of SOTER's spec monitor and one update of rtamt's, on margins that are computed already."""
    region, model = geofence.module.phi_safe, geofence.module.model
    assert region is not None
    margins = {id(view): region.margin(view) for view in views}
    ours, theirs = ModuleMonitor(model), stl_monitor()
    step = 0

    def look(view: Situation) -> None:
        nonlocal step
        step += 1
        ours.look(step * TICK_S, margins[id(view)], Controller.AC, Controller.AC)

    def update(view: Situation) -> object:
        nonlocal step
        step += 1
        return theirs.update(step, [("margin", margins[id(view)])])

    return look, update


def first_call_s(call: Callable[[Situation], object], view: Situation) -> float:
    """Return how long the first call took, compiling included."""
    start_s = time.perf_counter()
    call(view)
    return time.perf_counter() - start_s


def main(argv: Sequence[str] | None = None) -> dict[str, float]:
    """Measure and print; return the medians in microseconds.

    Raises:
        SystemExit: the other libraries are not installed, or the filter takes for unsafe what SOTER takes for safe.
    """
    quick = arguments(__doc__ or "", argv).quick
    count, rounds = (20, 2) if quick else (2000, 15)
    imported("run_time_assurance.rta", "rtamt")
    with bound_modules() as (workspace, modules), bound_modules("unicycle") as (_, tubes):
        geofence, tube = (next(m for m in each if m.name == GEOFENCE) for each in (modules, tubes))
        views = situations(workspace, modules, count)
        model = geofence.module.model
        assert model is not None
        # What is left of the horizon after the Delta that the filter predicts itself.
        simplex = simplex_filter(workspace, model.bound(LOOK_S + TICK_S))
        whole, monitor = filter_calls(simplex, views)
        look, update = spec_calls(geofence, views)
        compiled_s = first_call_s(whole, views[0])
        for module in (geofence, tube):
            module.mode = Controller.AC
        if not all(whole(view) and monitor(view) for view in views) or geofence.mode is not Controller.AC:
            sys.exit("the filter takes for unsafe what SOTER takes for safe: the two are not set up alike")
        sides = {
            "reference": reference,
            "SOTER, geofence": geofence.decide,
            "SOTER, geofence, unicycle": tube.decide,
            "run-time-assurance, monitor alone": monitor,
            "run-time-assurance, filter_control": whole,
            "SOTER, spec monitor": look,
            "rtamt, update": update,
        }
        times = in_turns({name: partial(median_us, call, views) for name, call in sides.items()}, rounds)
    medians = {name: statistics.median(each) for name, each in times.items()}
    plain_us, decision_us, spec_us = (medians[name] for name in ("reference", "SOTER, geofence", "SOTER, spec monitor"))
    rows = [Row("SOTER, geofence", f"{decision_us:.2f} us")]
    for name, own_us in (
        ("SOTER, geofence, unicycle", decision_us),
        ("run-time-assurance, monitor alone", decision_us),
        ("run-time-assurance, filter_control", decision_us),
    ):
        rows.append(Row(name, f"{medians[name]:.2f} us", medians[name] / own_us))
    rows.append(Row("SOTER, spec monitor", f"{spec_us:.2f} us"))
    rows.append(Row("rtamt, update", f"{medians['rtamt, update']:.2f} us", medians["rtamt, update"] / spec_us))
    remark = (
        f"Medians of {rounds} rounds over {count} situations; a call with math.hypot takes {plain_us:.2f} us. "
        f"The filter's first call, which compiles it, takes {compiled_s:.2f} s."
    )
    show("One decision, and one look, over those of SOTER", rows, remark)
    return medians


if __name__ == "__main__":
    main()
