"""Harness of the conformance kit for simulated robots behind a mux: the common part of all such adapters."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Final

from soter.adapters.velocity_controlled.simulator import VelocityControlledSimulator
from soter.conformance import RelayedHarness
from soter.conformance.impaired import ImpairedRelay, Line

INTRUDES_M_S: Final = 0.05
INTRUDES_RAD_S: Final = 0.5
"""The velocities that a program beside SOTER asks for."""

_EVERY_S: Final = 0.05


class VelocityControlledRelay(ImpairedRelay, ABC):
    """A relay that can also say velocities which nobody has sent."""

    @abstractmethod
    def intrude(self, robot_id: int, seconds: float, speed_m_s: float, yaw_rate_rad_s: float) -> None:
        """Have a program beside SOTER publish velocities for a base, past its mux, where SOTER hears them too."""

    def repeat(self, line: Line, message: bytes, seconds: float) -> None:
        """Say a message again and again for some time."""
        self.say(line, message, round(seconds / _EVERY_S), _EVERY_S)


class VelocityControlledHarness(RelayedHarness):
    """Brings faults into robots, each of which is a base in a world and a mux in a process of its own."""

    def stall(self, robot_id: int, seconds: float) -> None:
        """Suspend a robot's mux for a time; its base goes on."""
        self.stopped(self._simulated().muxes[robot_id], seconds)

    def step_clock(self, robot_id: int, seconds: float) -> None:
        """Set a robot's own clock forward, or back if negative; the world goes on."""
        self._simulated().faults.step_clock(robot_id, seconds)

    def stop_clock(self, robot_id: int) -> None:
        """Let a robot's own clock stand still from now on; the world goes on."""
        self._simulated().faults.stop_clock(robot_id)

    def restart(self, robot_id: int) -> None:
        """Restart a robot's base and mux; the world goes on."""
        self._simulated().restart(robot_id)

    def intrude(self, robot_id: int, seconds: float, turns: bool) -> None:
        """Have another program publish velocities for a base, past its mux."""
        assert isinstance(self.relay, VelocityControlledRelay)
        self.relay.intrude(robot_id, seconds, *((0.0, INTRUDES_RAD_S) if turns else (INTRUDES_M_S, 0.0)))

    def _simulated(self) -> VelocityControlledSimulator:
        assert isinstance(self.simulator, VelocityControlledSimulator)
        return self.simulator
