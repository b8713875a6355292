"""The gate on the vehicle's side: MAV_CMD_DO_GUIDED_MASTER names the active controller, if the vehicle supports it.

Such a vehicle takes targets from the named component only, and drops the target when another component is named. A
target moves it only while the keeper, which named the component, repeats the command: the lease. The fifth parameter
holds the vehicle's time of the renewal, in milliseconds, so that a command that waited in a buffer renews nothing.
Real autopilots answer UNSUPPORTED. Then the adapter has to stand in, see `soter.adapters.mavlink.robot`.
"""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.adapters.mavlink.link import AUTOPILOT
from soter.adapters.mavlink.vehicle import Vehicle
from soter.sdk import Controller

KEEPER: Final[int] = mav.MAV_COMP_ID_MISSIONPLANNER
"""The supervisor's component: names the active controller, renews the lease, and sends all but the targets."""

SENDERS: Final = {
    Controller.AC: int(mav.MAV_COMP_ID_ONBOARD_COMPUTER),
    Controller.SC: int(mav.MAV_COMP_ID_ONBOARD_COMPUTER2),
}
"""The component that sends each controller's targets."""

COMPONENTS: Final = (KEEPER, *SENDERS.values())

CONTROLLERS: Final = {component: controller for controller, component in SENDERS.items()}


REPORT: Final = "GMASTER"
"""NAMED_VALUE_INT by which the vehicle reports: 256 times the system plus the active component, negative while the
lease is dead, 0 for none."""

LEASE_PARAMETER: Final = "SOTER_LEASE_MS"
"""How long the vehicle moves on without a renewal, in milliseconds of its own time."""

_FRESH_S: Final = 0.5
_MAV_FRAME: Final = mav.MAV_FRAME_GLOBAL


class Authority:
    """The vehicle's own gate and lease."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle: Final = vehicle
        self._system: Final = vehicle.link.system
        # 0 would mean now.
        self._newest_ms = 1

    def begin(self) -> None:
        """Begin anew: the vehicle's clock may have begun anew, too."""
        self._newest_ms = 1

    def name(self, component: int, renewed_s: float) -> None:
        """Make one of our components the active one, with a lease that begins at a vehicle's time."""
        # The vehicle ignores commands older than the newest. As its clock becomes better known, the vehicle time of a
        # moment may become a little earlier; a switch must not be refused for that.
        self._newest_ms = max(self._newest_ms, int(renewed_s * 1e3))
        self._send(float(self._system), float(component), self._newest_ms)

    def release(self) -> None:
        """Let every component send targets again; the vehicle is left without one."""
        self._send(0.0, 0.0, 0)

    def _send(self, system: float, component: float, renewed_ms: int) -> None:
        self._vehicle.send(KEEPER, "COMMAND_INT", {
            "target_system": self._vehicle.system, "target_component": AUTOPILOT, "frame": _MAV_FRAME,
            "command": mav.MAV_CMD_DO_GUIDED_MASTER, "current": 0, "autocontinue": 0,
            "param1": system, "param2": component, "param3": 0.0, "param4": 0.0,
            "x": renewed_ms, "y": 0, "z": 0.0,
        })  # fmt: skip

    def supported(self, since_s: float) -> bool | None:
        """Return whether the vehicle has a gate, by its answers since a steady time; None before it answers."""
        ack = self._vehicle.ack(mav.MAV_CMD_DO_GUIDED_MASTER, since_s)
        return None if ack is None else ack.result != mav.MAV_RESULT_UNSUPPORTED

    def reported(self) -> int | None:
        """Return which of our components the vehicle reports as active; None without a recent report."""
        report = self._vehicle.heard_since("NAMED_VALUE_INT", self._vehicle.now_s - _FRESH_S)
        if report is None or report.name.rstrip("\0") != REPORT:
            return None
        system, component = divmod(abs(report.value), 256)
        return component if system == self._system else None
