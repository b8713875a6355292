"""One robot on keys behind the narrow interface."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

from soter.adapters.zenoh.options import ZenohConfig
from soter.clock import VehicleClock
from soter.errors import RobotUnavailable
from soter.sdk import Capabilities, RobotSpec
from soter.streamed.robot import SETTLED, StreamedRobot, wait_for

if TYPE_CHECKING:
    import zenoh


class ZenohRobot(StreamedRobot):
    """One robot below a namespace.

    Args:
        spec: which robot.
        clock: follows the robots' clocks.
        session: to hear and say over.
        config: of the backend, with this robot in it.

    Attributes:
        namespace: what its keys begin with.
        wire: what is heard of it, and what it is told.
    """

    def __init__(self, spec: RobotSpec, clock: VehicleClock, session: zenoh.Session, config: ZenohConfig) -> None:
        # Only here: what a robot promises can be read where Zenoh is not installed.
        from soter.adapters.zenoh.wire import Wire

        place = config.robots[spec.id]
        super().__init__(spec, clock, place.odom_origin)
        self._config: Final = config
        self.namespace: Final = place.namespace
        who = f"commander-{self._order.session}"
        self.wire: Final = Wire(
            session, place.namespace, config.keys.of(place.namespace), stamped=config.stamped, who=who
        )
        self.wire.listen(self._take_odometry, self._take_battery, self._take_report)

    def _send_velocity(self, by: str, forward_m_s: float, turn_rad_s: float) -> None:
        clock = self._vehicle_clock
        self.wire.send_velocity(by, forward_m_s, turn_rad_s, clock.to_vehicle_s(self.id, clock.now()))

    def _send_order(self, text: str) -> None:
        self.wire.send_order(text)

    def _connect(self, timeout_s: float) -> Capabilities:
        clock = self.clock
        until_s = clock.steady_s() + timeout_s
        if not wait_for(self._all_heard, min(timeout_s, self._config.discovery_s)):
            raise RobotUnavailable(f"robot {self.id} at {self.namespace}: {self._missing()}")
        if not self._settle(until_s - clock.steady_s()):
            why = self._refusal() or (
                f"its mux takes no order; does it hear {self.wire.keys.order}, and does it know the robot's clock?"
            )
            raise RobotUnavailable(f"robot {self.id} at {self.namespace}: {why}")
        return replace(self.declared, reports_battery=bool(self.wire.keys.battery))

    def _all_heard(self) -> bool:
        battery = self._charge is not None or not self.wire.keys.battery
        return self._heard >= SETTLED and self._gate is not None and battery

    def _missing(self) -> str:
        return "nothing was heard"
