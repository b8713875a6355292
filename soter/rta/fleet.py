"""The supervisors of a fleet, ticked together."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Protocol

from soter.rta.assumptions import Assumption
from soter.rta.monitors import ROUNDING_S, BrokenAssumption, PeerMonitor
from soter.rta.situation import Sample
from soter.rta.supervisor import RobotSupervisor

PEER_SILENT_S: Final = 0.5
"""A robot that has been silent for longer may not be driven, nor may the robots that have not heard of it."""


class RemotePeer(Protocol):
    """A robot that another process supervises. Asked in the supervisor's thread, at every tick; never waits."""

    robot_id: int

    def sample(self) -> Sample | None:
        """Return the latest sample, or None while there is none.

        Its stamp is in this process's fleet time, never later than the sample was really taken, and never goes back.
        """

    def heard_of(self, robot_id: int) -> float:
        """Return the stamp of the latest sample of this process's robot that the peer has acknowledged.

        In this process's fleet time; minus infinity before the first acknowledgement.
        """

    def needs_charge(self) -> bool:
        """Return whether the peer is low on charge and on its way to charge."""

    def found(self) -> BrokenAssumption | None:
        """Return, and forget, the assumption that the peer's reports about itself broke; None if none did."""


@dataclass(frozen=True, slots=True)
class StillSample:
    """The last sample of a silent robot that has come to rest, with a later stamp.

    The stamp is such that top speed from it on bounds where the robot can really be; see `StillPeers`.
    """

    robot_id: int
    stamp_s: float
    x_m: float
    y_m: float
    z_m: float
    heading_rad: float
    vx_m_s: float
    vy_m_s: float
    vz_m_s: float | None
    battery: float | None


class StillPeers:
    """Bounds the positions of silent robots.

    The supervisor stops driving a robot that it does not hear of; the robot's lease runs out, and it stands. A robot of
    another supervisor holds when it does not know that it is heard. So both come to rest, and however long they stay
    silent, they are no farther from their last sample than top speed takes them in `still_s`.

    Args:
        still_s: how long a silent robot can move on after its last sample, with braking counted as half.
    """

    def __init__(self, still_s: float) -> None:
        self.still_s: Final = still_s

    def bounded(self, now_s: float, sample: Sample) -> Sample:
        """Return a sample that bounds where the robot is now: the one given, while the robot may still move."""
        least_s = now_s - self.still_s
        if sample.stamp_s >= least_s:
            return sample
        return StillSample(
            sample.robot_id, least_s, sample.x_m, sample.y_m, sample.z_m, sample.heading_rad,
            sample.vx_m_s, sample.vy_m_s, sample.vz_m_s, sample.battery,
        )  # fmt: skip


FEW = 6
"""Up to this many robots, all are peers of all: cheaper than sorting them into cells."""


class Neighbours:
    """Sorts robots into square cells as wide as the radius; peers are the robots of a cell and its eight neighbours.

    The cost grows linearly with the number of robots.

    Args:
        radius_m: robots nearer than this are always peers; some farther ones are too. If it is infinite, all are.
    """

    def __init__(self, radius_m: float) -> None:
        self._per_m = 1.0 / radius_m

    def assign(
        self, robots: Sequence[RobotSupervisor], samples: Sequence[Sample], others: Sequence[Sample] = ()
    ) -> None:
        """Refresh `situation.peers` of every robot; samples in `others` are those of remote robots, peers of all."""
        count = len(robots)
        if count <= FEW:
            known = (*samples, *others)
            for index, robot in enumerate(robots):
                robot.situation.peers = known[:index] + known[index + 1 :]
            return
        per_m, floor = self._per_m, math.floor
        cells: dict[tuple[int, int], list[Sample]] = {}
        places = []
        for sample in samples:
            place = (floor(sample.x_m * per_m), floor(sample.y_m * per_m))
            places.append(place)
            cells.setdefault(place, []).append(sample)
        for robot, sample, (column, row) in zip(robots, samples, places, strict=True):
            peers = []
            for near_column in (column - 1, column, column + 1):
                for near_row in (row - 1, row, row + 1):
                    members = cells.get((near_column, near_row))
                    if members:
                        peers += members
            peers.remove(sample)
            peers += others
            robot.situation.peers = peers


class Supervisor:
    """The supervisors of all robots of a fleet, ticked together.

    Args:
        robots: one supervisor a robot.
        base_tick_s: period of the tick.
        neighbour_radius_m: peers farther away than this are left out of a robot's situation; must exceed every
            distance at which a module or safe controller takes notice of a peer.
        before_decisions: the arbiter; called once a tick, after all robots were sensed and before any decides.
        peers: tests what robots report of themselves to their peers; None if no module looks at peers.
        still: bounds where silent robots are; None if no module looks at peers.
        remote: robots of other supervisors, which are peers of all robots here.
    """

    def __init__(
        self,
        robots: Sequence[RobotSupervisor],
        base_tick_s: float,
        neighbour_radius_m: float,
        before_decisions: Callable[[float, Mapping[int, RobotSupervisor]], None] | None = None,
        peers: PeerMonitor | None = None,
        still: StillPeers | None = None,
        remote: Sequence[RemotePeer] = (),
    ) -> None:
        self.robots: Final = {robot.robot_id: robot for robot in robots}
        self.base_tick_s: Final = base_tick_s
        self._list: Final = tuple(robots)
        self._neighbours = Neighbours(neighbour_radius_m)
        self._before_decisions = before_decisions
        self._peers = peers
        self._still = still
        self._remote: Final = tuple(remote)
        self._tick = 0

    def tick(self, now_s: float) -> None:
        """Do one tick at fleet time `now_s`; call it every `base_tick_s`."""
        robots = self._list
        samples = [robot.sense(now_s) for robot in robots]
        found: dict[int, BrokenAssumption] = {}
        if self._peers is not None:
            found = self._peers.look(now_s, samples)
            for robot in robots:
                if cause := robot.uncontrolled:
                    # An uncontrolled robot may go wherever its promise lets it, and gives way to nobody.
                    found.setdefault(
                        robot.robot_id, BrokenAssumption(Assumption.PEERS, f"robot {robot.robot_id}: {cause}")
                    )
        others = self._hear(now_s, found) if self._remote else ()
        if found and self._still is not None:
            samples = [self._still.bounded(now_s, sample) for sample in samples]
        self._neighbours.assign(robots, samples, others)
        self._distrust(found)
        if self._before_decisions is not None:
            self._before_decisions(now_s, self.robots)
        tick = self._tick
        counter = time.perf_counter
        begun_s = counter()
        for robot in robots:
            robot.decide(tick)
            ended_s = counter()
            robot.decide_s, begun_s = ended_s - begun_s, ended_s
        for robot in robots:
            robot.act()
        self._tick = tick + 1

    def _hear(self, now_s: float, found: dict[int, BrokenAssumption]) -> list[Sample]:
        """Return the samples of remote robots; hold every robot that does not know enough of one of them.

        Both sides hold: the robot that does not hear the other, and the robot that does not know that it is heard.
        """
        samples = []
        for peer in self._remote:
            sample, finding = peer.sample(), peer.found()
            if finding is not None:
                found[peer.robot_id] = finding
            if sample is not None:
                samples.append(sample if self._still is None else self._still.bounded(now_s, sample))
            for robot in self._list:
                held = _silence(now_s, peer, sample, robot.robot_id)
                if held is not None:
                    robot.hold(held)
        return samples

    def _distrust(self, found: Mapping[int, BrokenAssumption]) -> None:
        """Tell every robot which of its peers broke what is assumed of peers."""
        if not found:
            return
        for robot in self._list:
            for peer in robot.situation.peers:
                finding = found.get(peer.robot_id)
                if finding is not None:
                    robot.distrust(finding)


def _silence(now_s: float, peer: RemotePeer, sample: Sample | None, robot_id: int) -> BrokenAssumption | None:
    """Return how a peer's silence keeps a robot from moving; None if it may move."""
    if sample is None:
        return BrokenAssumption(Assumption.PEERS, f"robot {peer.robot_id}: not heard of yet")
    silent_s = now_s - sample.stamp_s
    if silent_s > PEER_SILENT_S + ROUNDING_S:
        cause = f"robot {peer.robot_id}: not heard of for {silent_s:.3f} s"
        return BrokenAssumption(Assumption.PEERS, cause, silent_s - PEER_SILENT_S, "s")
    unheard_s = now_s - peer.heard_of(robot_id)
    if unheard_s > PEER_SILENT_S + ROUNDING_S:
        cause = f"robot {peer.robot_id} is not known to have heard of this one for {unheard_s:.3f} s"
        return BrokenAssumption(Assumption.PEERS, cause, unheard_s - PEER_SILENT_S, "s")
    return None
