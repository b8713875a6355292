"""The backends `pybullet` and `kinematic`: one adapter over two engines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, ClassVar, Final, Literal, Self

from pydantic import Field, model_validator

from soter.clock import Clock, VirtualClock
from soter.config.promises import Promise
from soter.config.table import wrong
from soter.errors import BackendUnavailable, RobotUnavailable
from soter.hints import install_command
from soter.onboard.drive import OVERSHOOT_M, TUBE_M, Drive, DriveLimits, tube_m
from soter.onboard.mux import Mux
from soter.sdk import (
    INTERFACE_VERSION,
    Backend,
    BackendConfig,
    Capabilities,
    Controller,
    Fleet,
    Goal,
    Link,
    Robot,
    RobotSpec,
    RobotState,
)
from soter.sdk.capabilities import REST_M_S, REST_RAD_S
from soter_sim import BODY_RADIUS_M, LIMITS, MOST_BOXES, Impairment, World, boxes_of_map, in_window

_UP: Final = Link.UP


class SimVehicle:
    """The software on a simulated robot; the world calls its `control` once in each control period.

    Args:
        lease_s: how long the robot moves after a renewal, at most.
        limits: the limits of its drive.
        period_s: the control period.

    Attributes:
        mux: the active controller, and its goal.
    """

    __slots__ = ("_drive", "mux")

    def __init__(self, lease_s: float, limits: DriveLimits, period_s: float) -> None:
        # The lease is checked once a period.
        self.mux: Mux[Controller, Goal] = Mux(Controller.SC, int(lease_s / period_s + _ROUNDING) * period_s)
        self._drive = Drive(limits, period_s)

    def control(
        self, now_s: float, x_m: float, y_m: float, heading_rad: float, v_m_s: float, yaw_rate_rad_s: float
    ) -> tuple[float, float]:
        """Return the speed and the turn rate for the next period; see `soter_sim.Control`."""
        goal = self.mux.passing(now_s)
        return self._drive.command(x_m, y_m, heading_rad, v_m_s, yaw_rate_rad_s, None if goal is None else goal.target)


PERIOD_S: Final = 0.05
LEASE_S: Final = 0.1

# Largest rounding error of fleet time, which is summed up tick by tick.
_ROUNDING_S: Final = 1e-6
_ROUNDING: Final = 1e-9


class SimulatedRobot(Robot):
    """A robot of a world in this process.

    Calls act at the beginning of the next control period, and samples are taken at its end, so that at whole periods
    of the fleet's clock a sample is never old.

    Args:
        spec: which robot.
        clock: the fleet's clock, which advances the world.
        world: the simulated world.
    """

    declared: ClassVar[Capabilities] = Capabilities(
        in_process=True,
        deterministic=True,
        reverses=True,
        reports_battery=True,
        reports_controller=True,
        v_max_m_s=LIMITS.v_max_m_s,
        yaw_rate_max_rad_s=LIMITS.yaw_rate_max_rad_s,
        brake_m_s2=LIMITS.brake_m_s2,
        body_radius_m=BODY_RADIUS_M,
        latency_s=PERIOD_S,
        sample_age_s=0.0,
        jitter_s=0.0,
        setpoint_period_s=PERIOD_S,
        lease_s=LEASE_S,
        tube_m=TUBE_M,
        overshoot_m=OVERSHOOT_M,
        # Rigid bodies deviate from the motors' commands: they slip sideways, by at most 1 mm/s, and overshoot a ramp.
        accel_m_s2=LIMITS.accel_m_s2,
        speed_noise_m_s=0.002,
        heading_noise_rad=0.001,
        position_noise_m=0.001,
        pivots_first=True,
    )

    def __init__(self, spec: RobotSpec, clock: Clock, world: World) -> None:
        super().__init__(spec, clock)
        self._world = world
        self._index = world.index(spec.id)
        bodies = world.bodies
        self._x, self._y, self._heading, self._yaw_rate = bodies.x, bodies.y, bodies.heading, bodies.yaw_rate
        self._v, self._charge = bodies.v, bodies.charge
        self._velocity = world.engine.velocity
        self._vehicle = SimVehicle(self.declared.lease_s, bodies.limits[self._index], world.period_s)
        self._mux = self._vehicle.mux
        self._id, self._now = spec.id, clock.now
        self._latest: RobotState | None = None

    def impair(self, left: float, right: float, brake: float, alive: bool) -> None:
        """Impair the vehicle from now on; the optional hook of fault injection, see `soter.faults.Impairable`.

        Args:
            left: part of the left wheel's motion that reaches the ground, from 0 to 1.
            right: the same of the right wheel.
            brake: part of the deceleration that is left, from 0 to 1.
            alive: False switches the motors off; the active controller, its goal and its lease are forgotten.
        """
        self._world.impair(self.id, Impairment(left, right, brake, alive))
        if not alive:
            self._mux.revoke()
            self._mux.switch(Controller.SC)

    def _connect(self, timeout_s: float) -> Capabilities:
        self._world.set_control(self.id, self._vehicle.control)
        return self.declared

    def _send_goto(self, goal: Goal) -> None:
        self._mux.give(goal.by, goal, self._world.now_s)

    def _sample(self) -> RobotState:
        vehicle_s = self._world.now_s
        now_s = self._now()
        if not -_ROUNDING_S < now_s - vehicle_s < _ROUNDING_S:
            # Between two periods the sample is that of the last period.
            now_s = vehicle_s
        mux = self._mux
        goal = mux.command
        goal_id = None if goal is None else goal.id
        latest = self._latest
        if (
            latest is not None
            and latest.stamp_s == now_s
            and latest.goal_id == goal_id
            and latest.controller is mux.in_charge
        ):
            return latest
        index = self._index
        east, north = self._velocity(index)
        # All fields in their order: a third of the time that the call of a named tuple takes.
        self._latest = latest = tuple.__new__(RobotState, (
            self._id, now_s, vehicle_s, self._x[index], self._y[index], 0.0, self._heading[index], east, north,
            self._yaw_rate[index], self._charge[index], mux.in_charge, goal_id, _UP, None,
        ))  # fmt: skip
        return latest

    def _hand_over(self, to: Controller) -> None:
        self._mux.switch(to)

    def _renew_lease(self) -> None:
        self._mux.renew(self._world.now_s)

    def _halt(self) -> None:
        self._mux.halt()

    def _disconnect(self, timeout_s: float) -> None:
        self._mux.revoke()
        index, period_s = self._index, self._world.period_s
        for _ in range(int(timeout_s / period_s)):
            if abs(self._v[index]) <= REST_M_S and abs(self._yaw_rate[index]) <= REST_RAD_S:
                break
            self.clock.sleep_until(self.clock.now() + period_s)


class KinematicRobot(SimulatedRobot):
    """A robot that only its motors move, so that it can promise exact samples."""

    declared: ClassVar[Capabilities] = replace(
        SimulatedRobot.declared, speed_noise_m_s=0.0, heading_noise_rad=0.0, position_noise_m=0.0
    )


class SimulatedPromise(Promise):
    """The promise that simulated robots are built to keep, within what a world with a fixed period allows."""

    v_max_m_s: Annotated[float, Field(ge=0.01, le=3.0, allow_inf_nan=False)] | None = None
    yaw_rate_max_rad_s: Annotated[float, Field(ge=0.1, le=6.0, allow_inf_nan=False)] | None = None
    brake_m_s2: Annotated[float, Field(ge=0.1, le=4.0, allow_inf_nan=False)] | None = None
    accel_m_s2: Annotated[float, Field(ge=0.1, le=4.0, allow_inf_nan=False)] | None = None
    body_radius_m: Annotated[float, Field(ge=0.05, le=1.0, allow_inf_nan=False)] | None = None
    latency_s: Annotated[float, Field(ge=PERIOD_S, le=60.0, allow_inf_nan=False)] | None = None
    setpoint_period_s: Annotated[float, Field(ge=PERIOD_S, le=PERIOD_S)] | None = None
    lease_s: Annotated[float, Field(ge=PERIOD_S, le=60.0, allow_inf_nan=False)] | None = None
    overshoot_m: Annotated[float, Field(ge=OVERSHOOT_M, le=100.0, allow_inf_nan=False)] | None = None
    reverses: Literal[True] | None = None
    pivots_first: Literal[True] | None = None

    @property
    def limits(self) -> DriveLimits:
        """The limits of the robots' drives."""
        given = {name: value for name, value in self.given.items() if name in DriveLimits.__slots__}
        return replace(LIMITS, **given)

    @model_validator(mode="after")
    def _can_be_kept(self) -> Self:
        strays_m = tube_m(self.limits, PERIOD_S)
        if self.tube_m is not None and self.tube_m < strays_m:
            raise wrong(("tube_m",), self.tube_m, f"at least {strays_m:g}: they stray so far at their top speed")
        return self


class PyBulletConfig(BackendConfig):
    """Options of the backend `pybullet`.

    Attributes:
        promise: differences of the robots from TurtleBots.
        engine: what moves the robots: rigid bodies, or the closed-form model of the backend `kinematic`.
        window: whether to show the rigid bodies in a window on the host's display. The run itself does not change.
    """

    promise: SimulatedPromise = SimulatedPromise()
    engine: Literal["pybullet", "kinematic"] = "pybullet"
    window: bool = False

    @model_validator(mode="after")
    def _has_something_to_show(self) -> Self:
        if self.window and self.engine != "pybullet":
            raise wrong(("window",), True, f"only with the engine pybullet: {self.engine} has no bodies to show")
        return self

    @model_validator(mode="after")
    def _has_room_for_the_map(self) -> Self:
        if self.engine == "pybullet" and (boxes := boxes_of_map(self.workspace)) > MOST_BOXES:
            raise wrong(
                ("engine",), self.engine, f"kinematic, since the map is made of {boxes} boxes, and PyBullet takes "
                f"{MOST_BOXES}; or a map with larger cells or less noise"
            )  # fmt: skip
        return self


class KinematicConfig(BackendConfig):
    """Options of the backend `kinematic`; `promise` has the differences of the robots from TurtleBots."""

    promise: SimulatedPromise = SimulatedPromise()
    engine: Literal["kinematic"] = "kinematic"


class SimulatedFleet(Fleet):
    """Robots of one world; to sleep on the fleet's clock advances the world.

    Attributes:
        world: the world, for recordings and views; robots are commanded through the interface.
    """

    def __init__(
        self, world: World, specs: Sequence[RobotSpec], robot_class: type[SimulatedRobot] = SimulatedRobot
    ) -> None:
        clock = VirtualClock(world.advance)
        super().__init__(clock, [robot_class(spec, clock, world) for spec in specs], world.truth)
        self.world = world

    def _close(self) -> None:
        self.world.close()


class PyBulletBackend(Backend):
    """Robots in a PyBullet world in this process, in virtual time."""

    interface_version: ClassVar[int] = INTERFACE_VERSION
    config_model: ClassVar[type[BackendConfig]] = PyBulletConfig
    robot_class: ClassVar[type[SimulatedRobot]] = SimulatedRobot

    @classmethod
    def promises(cls, config: PyBulletConfig | KinematicConfig) -> Capabilities:
        declared, asked = cls.robot_class.declared, config.promise
        widest_m = max(declared.tube_m, tube_m(asked.limits, PERIOD_S))
        return replace(declared, **{"tube_m": widest_m, **asked.given})

    def open(self, config: PyBulletConfig | KinematicConfig, robots: Sequence[RobotSpec]) -> SimulatedFleet:
        """Build the world and put the robots into it.

        Raises:
            RobotUnavailable: the robots cannot be put there; the message says why.
            BackendUnavailable: PyBullet is not installed.
        """
        try:
            shown = isinstance(config, PyBulletConfig) and config.window
            world = World(config.workspace, robots, in_window if shown else config.engine, config.limits)
        except ImportError as missing:
            raise BackendUnavailable(
                f"the engine '{config.engine}' needs PyBullet: {missing}; run: {install_command('pybullet')}; "
                "the engine 'kinematic' needs nothing"
            ) from missing
        except ValueError as failure:
            raise RobotUnavailable(str(failure)) from failure
        return SimulatedFleet(world, robots, self.robot_class)


class KinematicBackend(PyBulletBackend):
    """The robots of `PyBulletBackend`, moved in closed form: without physics, and many times faster."""

    config_model: ClassVar[type[BackendConfig]] = KinematicConfig
    robot_class: ClassVar[type[SimulatedRobot]] = KinematicRobot
