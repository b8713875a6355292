"""A backend as a user would bring it: the simulated robots, with other figures than a TurtleBot3 Burger's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Any, ClassVar, Final

from pydantic import Field

from soter.adapters.pybullet import KinematicBackend, KinematicConfig, SimulatedFleet
from soter.adapters.pybullet.backend import KinematicRobot
from soter.clock import Clock
from soter.onboard.drive import Drive
from soter.sdk import BackendConfig, Capabilities, RobotSpec
from soter_sim import BODY_RADIUS_M, LIMITS, World

NAME: Final = "soter.campaign.random.robots:Figured"

_Seconds = Annotated[float, Field(ge=0.0, le=1.0)]
_Metres = Annotated[float, Field(ge=0.0, le=0.5)]


class FiguredConfig(KinematicConfig):
    """What the robots promise. They are as slow as they say, and in everything else at least as good.

    Attributes:
        v_max_m_s: their top speed, which is the vehicle's too.
        brake_m_s2: how fast they brake; the drive counts on no more.
        latency_s: see `soter.sdk.Capabilities`, as for all that follow.
        sample_age_s: see there.
        jitter_s: see there.
        position_noise_m: see there.
        tube_m: see there.
        body_radius_m: see there.
    """

    v_max_m_s: Annotated[float, Field(gt=0.0, le=LIMITS.v_max_m_s)] = LIMITS.v_max_m_s
    brake_m_s2: Annotated[float, Field(gt=0.0, le=LIMITS.brake_m_s2)] = LIMITS.brake_m_s2
    latency_s: Annotated[float, Field(ge=0.05, le=1.0)] = KinematicRobot.declared.latency_s
    sample_age_s: _Seconds = 0.0
    jitter_s: _Seconds = 0.0
    position_noise_m: _Metres = 0.0
    tube_m: Annotated[float, Field(ge=0.02, le=0.5)] = KinematicRobot.declared.tube_m
    body_radius_m: Annotated[float, Field(ge=BODY_RADIUS_M, le=0.5)] = BODY_RADIUS_M

    def promised(self) -> Capabilities:
        """Return what the robots promise."""
        own = {name: getattr(self, name) for name in type(self).model_fields if name in Capabilities.__slots__}
        return replace(KinematicRobot.declared, **own)


class FiguredRobot(KinematicRobot):
    """A robot whose drive keeps to what it promises."""

    def __init__(self, spec: RobotSpec, clock: Clock, world: World) -> None:
        super().__init__(spec, clock, world)
        promised = self.declared
        limits = replace(LIMITS, v_max_m_s=promised.v_max_m_s, brake_m_s2=promised.brake_m_s2)
        self._drive: Final = Drive(limits, world.period_s)

    def _connect(self, timeout_s: float) -> Capabilities:
        self._world.set_control(self.id, self._steer)
        return self.declared

    def _steer(
        self, now_s: float, x_m: float, y_m: float, heading_rad: float, v_m_s: float, yaw_rate_rad_s: float
    ) -> tuple[float, float]:
        goal = self._mux.passing(now_s)
        return self._drive.command(x_m, y_m, heading_rad, v_m_s, yaw_rate_rad_s, None if goal is None else goal.target)


class Figured(KinematicBackend):
    """Robots with the figures of the configuration."""

    config_model: ClassVar[type[BackendConfig]] = FiguredConfig
    robot_class: ClassVar[type[FiguredRobot]] = FiguredRobot

    @classmethod
    def promises(cls, config: Any) -> Capabilities:
        promised: Capabilities = config.promised()
        return promised

    def open(self, config: Any, robots: Sequence[RobotSpec]) -> SimulatedFleet:
        class Promising(FiguredRobot):
            declared: ClassVar[Capabilities] = config.promised()

        class Opened(KinematicBackend):
            robot_class: ClassVar[type[FiguredRobot]] = Promising

        return Opened().open(config, robots)
