"""What happens to the first of some real vehicles while SOTER drives them; `missions.run` calls what is returned."""

from __future__ import annotations

import signal
import subprocess
import time
from collections.abc import Callable

from tests.autopilot.ardupilot import Autopilots

Happens = Callable[["subprocess.Popen[bytes]"], None]


def commanded(vehicles: Autopilots, number: int, *params: float) -> Happens:
    """Another ground station sends it a command."""
    return lambda _: vehicles.command(1, number, *params)


def sent_elsewhere(vehicles: Autopilots, x_m: float, y_m: float, height_m: float = 0.0) -> Happens:
    """Another ground station sends it to a place, for two seconds."""

    def send(_process: object) -> None:
        for _ in range(20):
            vehicles.send_to(1, x_m, y_m, height_m)
            time.sleep(0.1)

    return send


def without_gps(vehicles: Autopilots) -> Happens:
    """Its GPS falls silent."""

    def switch_off(_process: object) -> None:
        vehicles.set(1, "SIM_GPS_DISABLE", 1.0)
        vehicles.set(1, "SIM_GPS1_ENABLE", 0.0)  # its name from 4.7 on

    return switch_off


def setting(vehicles: Autopilots, name: str, value: float) -> Happens:
    """Another ground station sets a parameter."""
    return lambda _: vehicles.set(1, name, value)


def stopped(vehicles: Autopilots, lasts_s: float) -> Happens:
    """Its program stands still for a time."""

    def pause(_process: object) -> None:
        vehicles.processes[1].send_signal(signal.SIGSTOP)
        time.sleep(lasts_s)
        vehicles.processes[1].send_signal(signal.SIGCONT)

    return pause


def killed(vehicles: Autopilots) -> Happens:
    """Its program ends."""
    return lambda _: vehicles.kill(1)


def restarted(vehicles: Autopilots) -> Happens:
    """Its program ends, and is started anew where the vehicle was at first."""

    def restart(_process: object) -> None:
        vehicles.kill(1)
        time.sleep(0.5)
        vehicles.start(1)

    return restart
