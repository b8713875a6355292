"""The backend `zenoh`: given robots on Zenoh keys, or simulated ones that are started for the run."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar, Final

from soter.adapters.velocity_controlled.options import promising
from soter.adapters.velocity_controlled.robot import VelocityControlledRobot, wait_for
from soter.adapters.zenoh.options import ZenohConfig, ZenohRobotOptions
from soter.adapters.zenoh.session import close_session, open_session
from soter.adapters.zenoh.simulator import ZenohSimulator
from soter.clock import VehicleClock
from soter.errors import RobotUnavailable
from soter.sdk import INTERFACE_VERSION, BackendConfig, Capabilities, Robot, RobotSpec
from soter.sdk.wire import WireBackend

if TYPE_CHECKING:
    import zenoh

_LISTEN_S: Final = 0.5
"""How long to listen for other programs that drive a robot, before it is taken."""


class ZenohRobot(VelocityControlledRobot):
    """One robot whose keys begin with a namespace."""

    def __init__(self, spec: RobotSpec, clock: VehicleClock, session: zenoh.Session, config: ZenohConfig) -> None:
        # Imported here, so that promises can be read without Zenoh.
        from soter.adapters.zenoh.wire import Wire

        place = config.robots[spec.id]
        super().__init__(spec, clock, place.odom_origin, rate=config.speedup)
        self._config: Final = config
        self.namespace: Final = place.namespace
        self.wire: Final = Wire(session, config, place.namespace, f"commander-{self._order.session}")
        self.wire.listen(self._take_odometry, self._take_battery, self._take_report)

    def _send_velocity(self, by: str, forward_m_s: float, turn_rad_s: float) -> None:
        clock = self._vehicle_clock
        self.wire.send_velocity(by, forward_m_s, turn_rad_s, clock.to_vehicle_s(self.id, clock.now()))

    def _send_order(self, text: str) -> None:
        self.wire.send_order(text)

    def _connect(self, timeout_s: float) -> Capabilities:
        clock, wire = self.clock, self.wire
        until_s = clock.steady_s() + timeout_s
        if not self._discover(min(timeout_s, self._config.discovery_s), battery=bool(wire.keys.battery)):
            raise self._unavailable(self._missing())
        # The mux reports the end of another program's lease a little late.
        if not wait_for(lambda: not self._follows_another(), _LISTEN_S):
            raise self._unavailable(self._refusal() or "its mux follows one program after another")
        others = wire.others(_LISTEN_S)
        if others:
            raise self._unavailable(f"{'; '.join(others)}; let them publish it on {wire.keys.cmd_vel_ac}")
        if not self._settle(until_s - clock.steady_s()):
            raise self._unavailable(
                self._refusal()
                or f"its mux takes no order; does it hear {wire.keys.order}, and does it know the robot's clock?"
            )
        wire.watch(self._take_intruder)
        return replace(self.declared, reports_battery=bool(wire.keys.battery))

    def _missing(self) -> str:
        """Return which messages were not heard, and likely causes."""
        missing = self.wire.missing() or ["what was heard makes no sense"]
        return (
            f"within {self._config.discovery_s:g} s: {'; '.join(missing)}. Is the robot running, with "
            "`soter zenoh-mux` beside it, and are the namespace, the keys and the session in [backends.zenoh] right?"
        )

    def _unavailable(self, why: str) -> RobotUnavailable:
        return RobotUnavailable(f"robot {self.id} at {self.namespace}: {why}")


class ZenohBackend(WireBackend):
    """Robots on Zenoh keys, and the session to reach them."""

    interface_version: ClassVar[int] = INTERFACE_VERSION
    config_model: ClassVar[type[BackendConfig]] = ZenohConfig
    robot_class: ClassVar[type[Robot]] = ZenohRobot
    harness: ClassVar[str] = "soter.adapters.zenoh.harness:ZenohHarness"

    @classmethod
    def promises(cls, config: ZenohConfig) -> Capabilities:
        return config.promised()

    @classmethod
    def clock(cls, config: ZenohConfig) -> VehicleClock:
        return VehicleClock(rate=config.speedup)

    @classmethod
    def simulate(cls, config: ZenohConfig, robots: Sequence[RobotSpec]) -> ZenohSimulator:
        return ZenohSimulator(
            config.workspace, robots, config.session,
            stamped=config.stamped, speedup=config.speedup, private=True, limits=config.limits,
        )  # fmt: skip

    @classmethod
    def located(cls, config: ZenohConfig, simulator: ZenohSimulator) -> ZenohConfig:
        robots = {robot_id: ZenohRobotOptions(namespace=name) for robot_id, name in simulator.namespaces.items()}
        return config.model_copy(update={"robots": robots, "session": simulator.session, "truth": simulator.truth})

    def connect(
        self, config: ZenohConfig, robots: Sequence[RobotSpec], clock: VehicleClock, shared: ExitStack
    ) -> Sequence[ZenohRobot]:
        session = open_session(config.session)
        shared.callback(close_session, session)
        return [ZenohRobot(promising(spec, config), clock, session, config) for spec in robots]
