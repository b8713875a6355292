"""The simulated robots as a program: `python -m soter_lcm.robots WORKSPACE.xml`; see `soter_sim.commanded`.

All of them are on one bus, on which every robot has a channel for commands and one for reports.
"""

from __future__ import annotations

import select
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Final

from soter.geometry.workspace import Workspace
from soter.onboard.command import Command, Report
from soter.sdk import RobotSpec, RuleLimits
from soter_lcm.bus import Bus, free_url
from soter_lcm.wire import command_channel, decode_command, encode_report, report_channel
from soter_sim.commanded import CommandedEndpoint, run


class Endpoint(CommandedEndpoint):
    """The robots' end of the bus.

    Args:
        workspace: fence, boxes, chargers.
        robots: its robots.
        limits: what the mission promises.
        truth_port: where to tell the truth.
        at: by robot, the bus that it had before.
    """

    def __init__(
        self,
        workspace: Workspace,
        robots: Sequence[RobotSpec],
        limits: RuleLimits,
        truth_port: int,
        at: Mapping[int, str],
    ) -> None:
        super().__init__(workspace, robots, limits, truth_port)
        self._url: Final = next(iter(at.values()), None) or free_url()
        self._bus: Final = Bus(self._url, {command_channel(each): partial(self.take, each) for each in self.vehicles})

    @property
    def addresses(self) -> dict[int, str]:
        return dict.fromkeys(self.vehicles, self._url)

    def _wait(self, seconds: float) -> None:
        select.select([self._bus], [], [], seconds)

    def _hear(self) -> None:
        self._bus.hear()

    def _say(self, robot_id: int, message: bytes) -> None:
        self._bus.say(report_channel(robot_id), message)

    def _encode(self, report: Report) -> bytes:
        return encode_report(report)

    def _decode(self, message: bytes) -> Command:
        return decode_command(message)

    def _end(self) -> None:
        self._bus.close()


if __name__ == "__main__":
    run("soter_lcm.robots", "robots on LCM", Endpoint)
