"""What the conformance kit needs from an adapter's author: a way to open robots and, for wires, ways to break them."""

from __future__ import annotations

import subprocess
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

from soter.geometry.workspace import Box, RobotPlace
from soter.sdk import Capabilities, Fleet, RobotSpec, RuleLimits, Waypoint

HOOKS: Final = ("cut", "delay", "loss", "duplicate", "reorder", "start_driver", "observe")
"""The optional methods of a harness. One that a subclass does not override is not given."""

EXTRA_HOOKS: Final = (
    "second", "step_clock", "restart", "promising", "charged", "choosing", "switchable", "stall", "killable",
    "stop_clock", "garble", "seize", "by_hand", "shown", "disable", "intrude", "another", "faster",
    "refusing",
)  # fmt: skip
"""More optional methods, which not every harness can give; an adapter may conform without."""


LOW_CHARGE: Final = 0.1
"""Charge that simulated robots start with: low, to show faults at a low charge, and charges reported too high."""

_IDLE_S: Final = 2400.0
"""How long a full battery of simulated robots lasts at rest: short enough to show within half a minute."""

LEG_M: Final = 8.0
"""Length of the long leg of the kit's own simulated robots, on open ground."""

BESIDE_LEG_M: Final = 0.91
"""How far south of the start the box beside that leg begins."""

FOR_EVER_S: Final = 1e6
"""Time to empty, or to charge, a battery whose charge is to stay the same."""

LIMITS: Final = RuleLimits(separation_m=0.45)
"""Limits that the truth of simulated robots judges by; they differ from every world's default."""


def beside_leg(start: tuple[float, float]) -> Box:
    """Return a box beside the end of the long leg to the west of a start; robots must pass it undisturbed."""
    x_m, y_m = start
    return Box(x_m - LEG_M, y_m - 1.3, x_m - 0.9 * LEG_M, y_m - BESIDE_LEG_M)


def specs_at(
    places: Iterable[RobotPlace],
    promised: Capabilities | None = None,
    charge: float | None = None,
    lasts_s: float = FOR_EVER_S,
    charge_s: float = FOR_EVER_S,
) -> list[RobotSpec]:
    """Return simulated robots at these places, for the kit to judge.

    Args:
        places: where they start.
        promised: the promises asked of the last robot.
        charge: the constant charge of their batteries; None for a low charge that changes as they drive.
        lasts_s: how long a full battery lasts if `charge` is given, driving or not.
        charge_s: how long it then takes to charge one.
    """
    specs = [RobotSpec(at.id, at.x_m, at.y_m, at.heading_rad, LOW_CHARGE, idle_s=_IDLE_S) for at in places]
    specs[-1] = replace(specs[-1], promised=promised)
    if charge is None:
        return specs
    return [replace(each, battery=charge, drive_s=lasts_s, idle_s=lasts_s, charge_s=charge_s) for each in specs]


class Switchable(NamedTuple):
    """A robot whose program can be switched off, together with the connections to it.

    Attributes:
        fleet: the adapter's connection to the robot itself.
        off: ends the robot's program.
        on: starts the program again, at the same address.
    """

    fleet: Fleet
    off: Callable[[], object]
    on: Callable[[], object]


class Killable(NamedTuple):
    """A simulated robot that the backend has started itself.

    Attributes:
        fleet: what the backend opened without being given a robot.
        kill: ends the program that simulates the robot, without a warning.
    """

    fleet: Fleet
    kill: Callable[[], object]


class Harness(ABC):
    """Opens the robots of one backend for the kit.

    Only `open` and `close` must be written. The other methods are optional hooks; the clauses that need one that is
    not given are NOT TESTED, and a backend that is not in process conforms only if all those of `HOOKS` are given.

    The kit opens up to `robots_most` robots, one fleet at a time, and calls `close` after every clause. It drives
    robots only inside their free rooms.

    Attributes:
        name: what reports call the adapter.
        found_as: what it was found by, so that other processes find it, too; set by the kit.
        room_m: the side of the free square around every robot's start pose, in which the kit may drive it; at least
            2 m, more for robots that need more than 0.3 m to stop or to get up to speed: clauses that fail in too small
            a room say what would do. Rooms of two robots do not overlap.
        leg_m: how far a robot may be driven to the west of its start, within 0.1 rad of the frame's negative x axis; 0
            where there is no room for a long leg.
        charges_at_start: whether a robot at rest at its start pose is being charged, and its battery not full at first.
        contacts: whether robots are simulated, so that they may be driven into each other, and truth counts contacts.
        robots_most: how many robots `open` can give; clauses that need more are not tested. Best as many as will be
            used together, since an adapter can be right for two robots and wrong for the third.
        limits: what the truth of simulated robots was told to judge by, or None; best not its default.
        connect_timeout_s: what the kit passes to `Robot.init`.
        speedup: how many seconds of fleet time may pass in one second of the host; needed for `start_driver` only.
        side_by_side: whether several fleets may be open at once on this host, by processes that know nothing of each
            other: their robots are simulated, each fleet has its own, and ports are free ones. `soter conform --jobs`
            tries one clause after another where it is False.
        a_core: how many clauses a core of the host can try at once, if they are tried side by side: most of a clause is
            waiting. Fewer for robots whose programs take much of a core.
        starts_robots: whether `open` starts robots afresh at the start poses in their specs. If it only connects to a
            running one, the kit drives it back to its start before each clause, and stops it if it leaves its room.
        clause_limit_s: a clause that takes longer on the host counts as hanging, and fails.
        judges: whether figures are judged by the capabilities; if not, they are only recorded and fail no clause.
    """

    name: str
    found_as: str = ""
    room_m: float = 2.0
    leg_m: float = 0.0
    charges_at_start: bool = False
    contacts: bool = False
    robots_most: int = 2
    limits: RuleLimits | None = None
    connect_timeout_s: float = 10.0
    speedup: float = 1.0
    side_by_side: bool = False
    a_core: int = 4
    starts_robots: bool = True
    clause_limit_s: float = 180.0
    judges: bool = True

    @abstractmethod
    def open(self, robots: int) -> Fleet:
        """Return a fleet of `robots` fresh robots, at rest at the start poses in their specs; do not call `init`.

        Fresh means that nothing is left of the fleet before: a simulated world is started anew, a real robot is
        driven back to its start. `robots` is 1 to `robots_most`. Start poses need two different coordinates and a
        heading other than 0, 90, 180 and 270 degrees, so that mixed-up axes show.
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
        """End `cut`. A harness that gives `cut` must give this too."""
        raise NotImplementedError

    def delay(self, seconds: float) -> None:
        """Deliver every message later by `seconds` of fleet time, both ways; 0 ends it."""
        raise NotImplementedError

    def loss(self, fraction: float) -> None:
        """Lose this share of all messages, both ways, at random from a fixed seed; 0 ends it."""
        raise NotImplementedError

    def duplicate(self, fraction: float) -> None:
        """Deliver this share of all messages twice, both ways; 0 ends it."""
        raise NotImplementedError

    def reorder(self, fraction: float) -> None:
        """Deliver this share of all messages after their successors, both ways; 0 ends it."""
        raise NotImplementedError

    # --- optional hooks: when the SOTER side dies or hangs ----------------------------------------------------

    def start_driver(self, target: Waypoint) -> subprocess.Popen[bytes]:
        """Start another process that opens the first robot and drives it, and return that process. It replaces `open`.

        The robots (the simulated world, say) must not live in that process: the kit stops it with SIGSTOP or kills it
        with SIGKILL, and then watches the robot through `observe`. The process has to call
        `soter.conformance.driver.drive(fleet, target)`; `soter.conformance.driver.spawn` starts one.
        """
        raise NotImplementedError

    def observe(self, robot_id: int) -> tuple[float, float, float]:
        """Return where a robot really is: x_m, y_m, heading_rad, workspace frame, not through the adapter.

        Needed together with `start_driver`, and taken as the truth if the fleet has none.
        """
        raise NotImplementedError

    # --- extra hooks: an adapter may conform without these -----------------------------------------------------

    def second(self) -> Fleet:
        """Return another program's connection to the robots of the open fleet, beside the first one; no `init` yet.

        The kit closes it.
        """
        raise NotImplementedError

    def another(self) -> Harness:
        """Return a harness whose fleets may be open beside the one of this harness, in this process.

        Its robots are others, with the same ids. The kit closes it.
        """
        raise NotImplementedError

    def step_clock(self, robot_id: int, seconds: float) -> None:
        """Set a vehicle's own clock forward, or back if negative, while its program goes on."""
        raise NotImplementedError

    def stop_clock(self, robot_id: int) -> None:
        """Let a vehicle's own clock stand still from now on, while its program goes on."""
        raise NotImplementedError

    def restart(self, robot_id: int) -> None:
        """Restart a vehicle's program, which forgets active controller, target and lease; its clock begins at 0."""
        raise NotImplementedError

    def promising(self, promised: Capabilities, robots: int = 1) -> Fleet:
        """Return a fleet of fresh robots, as `open` does, of which the last is asked for these promises.

        They are `RobotSpec.promised` of that robot; the others have none.
        """
        raise NotImplementedError

    def charged(self, charge: float, lasts_s: float = FOR_EVER_S, charge_s: float = FOR_EVER_S) -> Fleet:
        """Return a fleet of one fresh robot, as `open` does, with this charge, which stays the same for minutes.

        If `lasts_s` is given, its full battery is empty after that time, driving or not; if `charge_s` is, an
        empty one is full after that time at a charger.
        """
        raise NotImplementedError

    def choosing(self, order: Sequence[int]) -> Fleet:
        """Return a fleet of some of `robots_most` fresh robots, all of which are running.

        The backend knows of all of them, and is asked for these.

        Args:
            order: the robots to open, in this order, as indices into the fleet of `open(robots_most)`.
        """
        raise NotImplementedError

    def switchable(self) -> Switchable:
        """Return a fleet of one fresh robot without a relay, and the calls that switch its program off and on."""
        raise NotImplementedError

    def killable(self) -> Killable:
        """Return a fleet of one simulated robot that the backend starts itself, and the call that kills its program.

        It is what missions get that name no address of a robot.
        """
        raise NotImplementedError

    def refusing(self) -> tuple[Fleet, str]:
        """Return a fleet of one fresh robot that refuses to get ready, and words in which the robot says why."""
        raise NotImplementedError

    def faster(self, speedup: float) -> Fleet:
        """Return a fleet of one simulated robot that the backend starts itself, and for which time passes faster.

        It is what missions get that ask for it: for the robot, and on the fleet's clock, so many seconds pass in each
        second of the host.
        """
        raise NotImplementedError

    def seize(self, robot_id: int) -> None:
        """Let a person take the robot from SOTER and stop it, as by a switch on it or at another ground station."""
        raise NotImplementedError

    def by_hand(self, robot_id: int) -> None:
        """Let a person take the robot from SOTER to drive it by hand, for now with the sticks at rest."""
        raise NotImplementedError

    def shown(self, robot_id: int) -> str:
        """Return, not through the adapter, how a robot shows itself to people: its mode, and that it is armed, say."""
        raise NotImplementedError

    def disable(self, robot_id: int) -> None:
        """Let a person switch the robot's motors off while it drives, as by a disarm at another ground station."""
        raise NotImplementedError

    def intrude(self, robot_id: int, seconds: float, turns: bool) -> None:
        """Have another program move the robot past its supervisor, again and again for some time; return at once.

        It drives the robot or, if `turns`, only turns it.
        """
        raise NotImplementedError

    def garble(self, fraction: float) -> None:
        """Deliver bytes that make no sense behind this share of all messages, both ways; 0 ends it."""
        raise NotImplementedError

    def stall(self, robot_id: int, seconds: float) -> None:
        """Suspend the program that receives and sends for a robot, as on a busy host; return at once.

        The robot itself goes on with its latest command.
        """
        raise NotImplementedError

    # --- for the kit ------------------------------------------------------------------------------------------

    def gives(self, hook: str) -> bool:
        """Return whether a hook of `HOOKS` or `EXTRA_HOOKS` is given: `cut` needs `restore` as well."""
        methods = ("cut", "restore") if hook == "cut" else (hook,)
        return all(getattr(type(self), method) is not getattr(Harness, method) for method in methods)
