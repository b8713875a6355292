"""What the conformance kit needs from an adapter's author: a way to open robots and, for wires, ways to break them."""

from __future__ import annotations

import subprocess
from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import Final

from soter.geometry.workspace import RobotPlace
from soter.sdk import Fleet, RobotSpec, Waypoint

HOOKS: Final = ("cut", "delay", "loss", "duplicate", "reorder", "start_driver", "observe")
"""The optional methods of a harness. One that a subclass does not override is not given."""

EXTRA_HOOKS: Final = ("second", "step_clock", "restart")
"""More of them, for what not every harness can do; an adapter may conform without."""


LOW_CHARGE: Final = 0.1
"""What simulated robots start with: what is weak when a battery is low shows, and so does a charge said too high."""

_IDLE_S: Final = 2400.0
"""How long a full battery of theirs lasts at rest: what that takes shows within half a minute."""


def specs_at(places: Iterable[RobotPlace]) -> list[RobotSpec]:
    """Return simulated robots at these places, for the kit to judge."""
    return [RobotSpec(at.id, at.x_m, at.y_m, at.heading_rad, LOW_CHARGE, idle_s=_IDLE_S) for at in places]


class Harness(ABC):
    """Opens the robots of one backend for the kit.

    Only `open` and `close` must be written. The other methods are optional hooks; the clauses that need one that is
    not given are NOT TESTED, and a backend that is not in process conforms only if all of them are.

    The kit opens one or two robots, one fleet at a time, and calls `close` after every clause. It drives robots only
    inside their free rooms.

    Attributes:
        name: what reports call the adapter.
        room_m: the side of the free square around every robot's start pose, in which the kit may drive it; at least
            2 m, more for robots that need more than 0.3 m to stop. Rooms of two robots do not overlap.
        charges_at_start: whether a robot at rest at its start pose is being charged, and its battery not full at first.
        contacts: whether the robots are simulated, so that they may be driven into each other, and truth counts that.
        connect_timeout_s: what the kit passes to `Robot.init`.
        speedup: how many seconds of fleet time may pass in one second of the host; needed for `start_driver` only.
        side_by_side: whether several fleets may be open at once on this host, by processes that know nothing of each
            other: their robots are simulated, each fleet has its own, and ports are free ones. `soter conform --jobs`
            tries one clause after another where it is False.
    """

    name: str
    room_m: float = 2.0
    charges_at_start: bool = False
    contacts: bool = False
    connect_timeout_s: float = 10.0
    speedup: float = 1.0
    side_by_side: bool = False

    @abstractmethod
    def open(self, robots: int) -> Fleet:
        """Return a fleet of so many fresh robots, at rest at the start poses in their specs; do not call `init`.

        Fresh means that nothing is left of the fleet before: a simulated world is started anew, a real robot is
        driven back to its start. `robots` is 1 or 2. Start poses need two different coordinates and a heading that is
        none of 0, 90, 180 and 270 degrees, so that mixed-up axes show.
        """

    @abstractmethod
    def close(self) -> None:
        """End all faults, and everything that `open` and `start_driver` started. Idempotent.

        The fleet itself has been closed by then, except where a clause failed to.
        """

    # --- optional hooks: faults on the wire between SOTER and the robots of the open fleet --------------------

    def cut(self, robot_id: int) -> None:
        """Let nothing through between SOTER and one robot, in either direction, until `restore`."""
        raise NotImplementedError

    def restore(self, robot_id: int) -> None:
        """End `cut`. To be given with it."""
        raise NotImplementedError

    def delay(self, seconds: float) -> None:
        """Deliver every message so much later, both ways, in fleet time; 0 ends it."""
        raise NotImplementedError

    def loss(self, fraction: float) -> None:
        """Lose this share of all messages, both ways, at random from a fixed seed; 0 ends it."""
        raise NotImplementedError

    def duplicate(self, fraction: float) -> None:
        """Deliver this share of all messages twice, both ways; 0 ends it."""
        raise NotImplementedError

    def reorder(self, fraction: float) -> None:
        """Deliver this share of all messages after the ones that followed them, both ways; 0 ends it."""
        raise NotImplementedError

    # --- optional hooks: when the SOTER side dies or hangs ----------------------------------------------------

    def start_driver(self, target: Waypoint) -> subprocess.Popen[bytes]:
        """Start another process that opens the first robot and drives it, and return that process. It replaces `open`.

        The robots (the simulated world, say) must not live in that process: the kit stops it with SIGSTOP or kills it
        with SIGKILL, and then watches the robot through `observe`. What the process does is
        `soter.conformance.driver.drive(fleet, target)`; `soter.conformance.driver.spawn` starts one.
        """
        raise NotImplementedError

    def observe(self, robot_id: int) -> tuple[float, float, float]:
        """Return where a robot really is: x_m, y_m, heading_rad, workspace frame, not through the adapter.

        Needed beside `start_driver`, and taken as the truth where the fleet has none.
        """
        raise NotImplementedError

    # --- extra hooks: without these an adapter may conform all the same ----------------------------------------

    def second(self) -> Fleet:
        """Return another program's connection to the robots of the open fleet, beside the first one; no `init` yet.

        The kit closes it.
        """
        raise NotImplementedError

    def step_clock(self, robot_id: int, seconds: float) -> None:
        """Set a vehicle's own clock forward, or back where negative, while it goes on."""
        raise NotImplementedError

    def restart(self, robot_id: int) -> None:
        """Restart a vehicle's program: it forgets who is in charge, its target and its lease; its clock begins at 0."""
        raise NotImplementedError

    # --- for the kit ------------------------------------------------------------------------------------------

    def gives(self, hook: str) -> bool:
        """Return whether a hook out of `HOOKS` or `EXTRA_HOOKS` is given: `cut` needs `restore` as well."""
        methods = ("cut", "restore") if hook == "cut" else (hook,)
        return all(getattr(type(self), method) is not getattr(Harness, method) for method in methods)
