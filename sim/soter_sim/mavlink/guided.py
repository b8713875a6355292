"""Who may say where to go in GUIDED, and for how long: the vehicle's own side of authority and dead man.

Until somebody names a master (MAV_CMD_DO_GUIDED_MASTER) it is as on any autopilot: everybody may. Who names one becomes
the keeper. The package's docstring has the rules.
"""

from __future__ import annotations

from math import inf
from typing import Final

from soter.onboard.mux import Mux
from soter_sim.mavlink.channel import Source
from soter_sim.mavlink.setpoint import Place, Setpoint, Velocity

VELOCITY_S: Final = 3.0
"""A velocity that is not sent again for this long ends; a place does not."""

# Numbers of packets go round: from half a round on, one counts as older.
_OVERTAKEN: Final = 128
# No packet is on its way for longer; who begins to count anew is heard again after this.
_OVERTAKING_S: Final = 5.0

NOBODY: Final = Source(0, 0)
"""In the place of a master: there is none, everybody may command."""


class Guided:
    """The target of a vehicle in GUIDED. Times are the vehicle's own, in seconds.

    Attributes:
        keeper: who named the master, and alone renews the lease; None if nobody has.
        subordinates: whom a keeper has named, other than itself: these may send targets and nothing else.
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
        """Whose targets are obeyed; `NOBODY`: everybody's."""
        return self._mux.in_charge

    def alive(self, now_s: float) -> bool:
        """Return whether the lease lives; without a keeper there is none that could end."""
        return self._mux.alive(now_s)

    def may_keep(self, by: Source, now_s: float) -> bool:
        """Return whether a sender may name the master: nobody else does, as long as a lease lives."""
        return by not in self.subordinates and (self.keeper in (None, by) or not self.alive(now_s))

    def may_command(self, by: Source, now_s: float, *, stops: bool) -> bool:
        """Return whether a sender may ask for what moves or changes the vehicle, other than by a target.

        Args:
            by: who asks.
            now_s: the vehicle's time.
            stops: it only stops the vehicle, which everybody may that is not a subordinate.
        """
        if by in self.subordinates:
            return False
        return stops or self.keeper in (None, by) or not self.alive(now_s)

    def may_go(self, by: Source) -> bool:
        """Return whether a sender's targets are obeyed."""
        return self.keeper is None or by == self.master

    def name(self, by: Source, master: Source, lease_s: float, since_s: float) -> bool:
        """Put a master in charge, or renew its lease; a change drops the target.

        Args:
            by: who asks; `may_keep` must be true of it.
            master: whose targets are to be obeyed; `NOBODY` gives the vehicle back to everybody, without a target.
            lease_s: what the lease lasts.
            since_s: since when.

        Returns:
            False if it was overtaken by a later one of the same keeper: then nothing has changed.
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

        It is not if it comes from somebody who is not in charge, or, with a keeper, was overtaken on the way by a later
        one of the master.

        Args:
            by: who sends it.
            target: what it is.
            now_s: the vehicle's time.
            seq: the number of its packet, from 0 to 255 and round again.
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
        """Take a target from whoever may command the vehicle, such as the height of a take-off."""
        self._mux.command_s = VELOCITY_S if isinstance(target, Velocity) else inf
        self._mux.give(self.master, target, now_s)

    def halt(self) -> None:
        """Drop the target; who is in charge stays so."""
        self._mux.halt()

    def target(self) -> Setpoint:
        """Return the target, whether or not it moves the vehicle now."""
        return self._mux.command

    def setpoint(self, now_s: float) -> Setpoint:
        """Return what to steer for now."""
        return self._mux.passing(now_s)

    def _open(self) -> None:
        self._mux = Mux(NOBODY, inf)
        self._renewed_s = -inf
        self._taken = None
        # Without a keeper the lease has no end, and begins with the clock.
        self._mux.renew(0.0)
