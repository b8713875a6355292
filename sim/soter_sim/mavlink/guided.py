"""Authority and lease in GUIDED: which sender's targets a vehicle obeys, and for how long.

Until a sender names a master (MAV_CMD_DO_GUIDED_MASTER), all senders' targets are obeyed, as on any autopilot. The
sender that names one becomes the keeper. The package's docstring has the rules.
"""

from __future__ import annotations

from math import inf
from typing import Final

from soter.onboard.mux import Mux
from soter_sim.mavlink.channel import Source
from soter_sim.mavlink.setpoint import Place, Setpoint, Velocity

VELOCITY_S: Final = 3.0
"""Time after which a velocity that is not sent again ends; a place does not."""

# Packet numbers wrap around: one that is half a round or more ahead counts as older.
_OVERTAKEN: Final = 128
# Longest delay of a packet; a sender that restarts its numbers is heard again after this.
_OVERTAKING_S: Final = 5.0

NOBODY: Final = Source(0, 0)
"""In place of a master: there is none, and every sender may command."""


class Guided:
    """The target of a vehicle in GUIDED. Times are the vehicle's own, in seconds.

    Attributes:
        keeper: the sender that named the master, and alone renews the lease; None without one.
        subordinates: components that a keeper other than itself has named: they may only send targets.
    """

    def __init__(self) -> None:
        self.keeper: Source | None = None
        self.subordinates: set[Source] = set()
        self._mux: Mux[Source, Place | Velocity]
        self._renewed_s: float
        self._taken: tuple[int, float] | None
        self._open()

    @property
    def master(self) -> Source:
        """The component whose targets are obeyed; `NOBODY` if all are."""
        return self._mux.in_charge

    def alive(self, now_s: float) -> bool:
        """Return whether the lease lives; always, without a keeper."""
        return self._mux.alive(now_s)

    def may_keep(self, by: Source, now_s: float) -> bool:
        """Return whether a sender may name the master: while a lease lives, only the keeper may."""
        return by not in self.subordinates and (self.keeper in (None, by) or not self.alive(now_s))

    def may_command(self, by: Source, now_s: float, *, stops: bool) -> bool:
        """Return whether a sender may move or change the vehicle other than by a target.

        Args:
            by: the sender.
            now_s: the vehicle's time.
            stops: whether the command only stops the vehicle, which every sender but a subordinate may do.
        """
        if by in self.subordinates:
            return False
        return stops or self.keeper in (None, by) or not self.alive(now_s)

    def may_go(self, by: Source) -> bool:
        """Return whether a sender's targets are obeyed."""
        return self.keeper is None or by == self.master

    def name(self, by: Source, master: Source, lease_s: float, since_s: float) -> bool:
        """Name a master, or renew its lease; a change drops the target.

        Args:
            by: the sender, for which `may_keep` must be true.
            master: the component whose targets are to be obeyed; `NOBODY` for all, which also drops the target.
            lease_s: duration of the lease.
            since_s: time from which it lasts.

        Returns:
            False if a later command of the same keeper has overtaken this one: then nothing has changed.
        """
        if self.keeper == by and since_s < self._renewed_s:
            return False
        if master == NOBODY:
            self.keeper = None
            self.subordinates.clear()
            self._open()
            return True
        if self.keeper != by:
            self.keeper = by
            self._mux = Mux(master, lease_s)
        self._mux.lease_s = lease_s
        if self._mux.switch(master):
            self._taken = None
        if master != by:
            self.subordinates.add(master)
        self._renewed_s = since_s
        self._mux.renew(since_s)
        return True

    def give(self, by: Source, target: Place | Velocity, now_s: float, seq: int) -> bool:
        """Take a target; return False, and change nothing, if it is not to be obeyed.

        That is so if its sender is not the master, or, with a keeper, if a later target of the master has overtaken it.

        Args:
            by: the sender.
            target: the target.
            now_s: the vehicle's time.
            seq: the number of its packet, from 0 to 255, wrapping around.
        """
        if not self.may_go(by):
            return False
        if self.keeper is not None:
            if self._taken is not None:
                last_seq, last_s = self._taken
                if (seq - last_seq) % 256 >= _OVERTAKEN and now_s - last_s < _OVERTAKING_S:
                    return False
            self._taken = seq, now_s
        self.put(target, now_s)
        return True

    def put(self, target: Place | Velocity, now_s: float) -> None:
        """Take a target of a command that was allowed already, such as the height of a take-off."""
        self._mux.command_s = VELOCITY_S if isinstance(target, Velocity) else inf
        self._mux.give(self.master, target, now_s)

    def halt(self) -> None:
        """Drop the target; the master stays."""
        self._mux.halt()

    def target(self) -> Setpoint:
        """Return the target, whether or not it moves the vehicle now."""
        return self._mux.command

    def setpoint(self, now_s: float) -> Setpoint:
        """Return the target that moves the vehicle now, if any."""
        return self._mux.passing(now_s)

    def _open(self) -> None:
        self._mux = Mux(NOBODY, inf)
        self._renewed_s = -inf
        self._taken = None
        # Without a keeper the lease is endless, and begins with the clock.
        self._mux.renew(0.0)
