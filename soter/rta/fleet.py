"""The supervisors of a fleet, ticked together."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Final

from soter.rta.monitors import Finding, PeerMonitor
from soter.rta.neighbours import Neighbours
from soter.rta.supervisor import RobotSupervisor


class Supervisor:
    """The supervisors of all robots of a fleet, ticked together.

    Args:
        robots: one supervisor a robot.
        base_tick_s: period of the tick.
        neighbour_radius_m: peers farther away than this are left out of a robot's situation; must exceed every
            distance at which a module or safe controller takes notice of a peer.
        before_decisions: called once a tick, after all robots were sensed and before any decides: the arbiter.
        peers: tests what robots report of themselves, for those that hear it; None where no module looks at peers.
    """

    def __init__(
        self,
        robots: Sequence[RobotSupervisor],
        base_tick_s: float,
        neighbour_radius_m: float,
        before_decisions: Callable[[float, Mapping[int, RobotSupervisor]], None] | None = None,
        peers: PeerMonitor | None = None,
    ) -> None:
        self.robots: Final = {robot.robot_id: robot for robot in robots}
        self.base_tick_s: Final = base_tick_s
        self._list: Final = tuple(robots)
        self._neighbours = Neighbours(neighbour_radius_m)
        self._before_decisions = before_decisions
        self._peers = peers
        self._tick = 0

    def tick(self, now_s: float) -> None:
        """Do one tick at fleet time `now_s`; call it every `base_tick_s`."""
        robots = self._list
        samples = [robot.sense(now_s) for robot in robots]
        self._neighbours.assign(robots, samples)
        if self._peers is not None:
            self._distrust(self._peers.look(now_s, samples))
        if self._before_decisions is not None:
            self._before_decisions(now_s, self.robots)
        tick = self._tick
        counter = time.perf_counter
        for robot in robots:
            start_s = counter()
            robot.decide(tick)
            robot.decide_s = counter() - start_s
        for robot in robots:
            robot.act()
        self._tick = tick + 1

    def _distrust(self, found: Mapping[int, Finding]) -> None:
        """Tell every robot which of its peers do not keep to what is assumed of them."""
        if not found:
            return
        for robot in self._list:
            for peer in robot.situation.peers:
                finding = found.get(peer.robot_id)
                if finding is not None:
                    robot.distrust(finding)
