"""Finds the harness for a name; makes one for robots that live in this process."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import Any, Final

from soter.conformance.given import Given, GivenHarness
from soter.conformance.harness import FOR_EVER_S, LEG_M, LIMITS, Harness, beside_leg, specs_at
from soter.errors import BackendError, ConfigError, UnknownBackend, nearest
from soter.geometry.workspace import Box, RobotPlace, Workspace
from soter.registry import load_backend
from soter.sdk import Backend, Capabilities, Fleet, RobotSpec

# Rooms of 2 m on open ground. All coordinates and headings differ, so that mixed-up ones show, and are so far from
# the origin that coordinates of too few bits show. For the ids see `soter.conformance.relayed.WIDE_ROOMS`.
_STARTS: Final = ((72, 142.0, 73.5, 0.4), (20, 145.5, 71.7, -2.2), (200, 142.7, 70.4, 2.6))


def open_floor() -> Workspace:
    """Return a floor with room for three robots, and a box beside the long leg of the first."""
    places = tuple(
        RobotPlace(number, x_m, y_m, Box(x_m - 0.3, y_m - 0.3, x_m + 0.3, y_m + 0.3, 0.0), heading_rad)
        for number, x_m, y_m, heading_rad in _STARTS
    )
    return Workspace(148.0, 76.0, (beside_leg(_STARTS[0][1:3]),), places)


class InProcessHarness(Harness):
    """Opens robots of a backend that lives in this process, on an open floor."""

    leg_m = LEG_M
    side_by_side = True
    charges_at_start = True
    contacts = True
    robots_most = len(_STARTS)
    limits = LIMITS

    def __init__(self, name: str, backend: type[Backend], **options: Any) -> None:
        self.name = name
        self.backend = backend
        self.options = options

    def open(self, robots: int) -> Fleet:
        """Return a fleet in a fresh world."""
        return self._opened(specs_at(_places(robots)))

    def promising(self, promised: Capabilities, robots: int = 1) -> Fleet:
        """Return robots in a fresh world; the last one has promises of its own."""
        return self._opened(specs_at(_places(robots), promised))

    def charged(self, charge: float, lasts_s: float = FOR_EVER_S, charge_s: float = FOR_EVER_S) -> Fleet:
        """Return a robot with a given charge in a fresh world."""
        return self._opened(specs_at(_places(1), None, charge, lasts_s, charge_s))

    def choosing(self, order: Sequence[int]) -> Fleet:
        """Return some robots in a fresh world whose workspace has places for all."""
        specs = specs_at(_places(self.robots_most))
        return self._opened([specs[each] for each in order], self.robots_most)

    def another(self) -> Harness:
        """Return this harness: every fleet has a world of its own."""
        return self

    def close(self) -> None:
        """Do nothing: the world ends with its fleet."""

    def _opened(self, specs: Sequence[RobotSpec], places: int | None = None) -> Fleet:
        floor = open_floor().with_robots(places or len(specs))
        config = self.backend.config_model(workspace=floor, limits=self.limits, **self.options)
        return self.backend().open(config, specs)


def _places(robots: int) -> Sequence[RobotPlace]:
    return open_floor().robots[:robots]


def named(target: str | Given) -> str:
    """Return the name of a target for messages."""
    return f"'{target}'" if isinstance(target, str) else f"robot {target.spec.id} of {target.backend}"


def find_harness(name: str | Given) -> Harness:
    """Return the harness for a backend's name, for `module:Harness`, or for a given robot.

    A backend names its harness in a class attribute `harness`, as `module:Class`; one whose robots live in this process
    needs none.

    Raises:
        BackendError: there is no such backend, it cannot be used here, or it has no harness.
        ConfigError: the name leads to something that is not a harness.
    """
    if isinstance(name, Given):
        target = getattr(load_backend(name.backend), "harness", None)
        between = None if target is None else getattr(_load(target), "between", None)
        return GivenHarness(name) if between is None else GivenHarness(name, between)
    harness = _harness_of(name)
    harness.found_as = name
    return harness


def _harness_of(name: str) -> Harness:
    if ":" in name:
        found = _load(name)
        if not (isinstance(found, type) and issubclass(found, Backend)):
            return _made(name, found)
    backend = load_backend(name)
    target = getattr(backend, "harness", None)
    if target is not None:
        return _made(target, _load(target))
    declared = getattr(backend.robot_class, "declared", None)
    if declared is None:
        raise BackendError(f"backend '{name}': its robot class declares no capabilities; set `declared`")
    if not declared.in_process:
        raise BackendError(
            f"backend '{name}' is on a wire and names no harness, so the kit does not know how to start its robots; "
            "write a subclass of soter.conformance.Harness and give it as 'module:Class', or name it in the backend's "
            "attribute `harness`"
        )
    return InProcessHarness(name, backend)


def _load(target: str) -> object:
    module_name, _, class_name = target.partition(":")
    try:
        module = importlib.import_module(module_name)
    except ModuleNotFoundError as failure:
        if failure.name and (module_name == failure.name or module_name.startswith(f"{failure.name}.")):
            raise UnknownBackend(
                f"'{target}': there is no module '{failure.name}'; check its spelling, and that it is on the path"
            ) from failure
        raise BackendError(f"'{target}': the library '{failure.name}' that it needs is not installed") from failure
    found = getattr(module, class_name, None)
    if found is None:
        raise ConfigError(f"module '{module_name}' has no '{class_name}'{nearest(class_name, list(vars(module)))}")
    return found


def _made(target: str, found: object) -> Harness:
    if isinstance(found, type) and issubclass(found, Harness):
        abstract = ", ".join(sorted(getattr(found, "__abstractmethods__", ())))
        if abstract:
            raise ConfigError(f"'{target}' is not complete: it does not define {abstract}")
        return found()
    if isinstance(found, Harness):
        return found
    raise ConfigError(f"'{target}' is neither a soter.conformance.Harness nor a soter.sdk.Backend")
