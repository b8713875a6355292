"""What SOTER's conformance kit needs to judge this adapter: its robots, behind a link that can be broken."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, Final

from soter.conformance import ImpairedRelay, Line
from soter.conformance.wire import WireHarness
from soter_lcm.adapter import LcmBackend
from soter_lcm.bus import Bus, free_url
from soter_lcm.wire import command_channel, report_channel


class LcmHarness(WireHarness):
    """Opens simulated robots behind a relay."""

    name = "lcm"
    backend = LcmBackend

    def impair(self, addresses: Mapping[int, Any]) -> Relay:
        return Relay(addresses)


class Relay(ImpairedRelay):
    """A bad link: a bus of its own, and what passes messages between that and the robots', or does worse to them.

    Args:
        addresses: by robot, the bus that it is on, one for all.

    Attributes:
        addresses: by robot, the bus that the relay is on.
    """

    def __init__(self, addresses: Mapping[int, str]) -> None:
        super().__init__()
        url, (real,) = free_url(), set(addresses.values())
        self.addresses: Final = dict.fromkeys(addresses, url)
        commands = {each: Line(each, partial(self._say_inside, command_channel(each))) for each in addresses}
        reports = {each: Line(each, partial(self._say_outside, report_channel(each))) for each in addresses}
        self._outside: Final = Bus(
            url, {command_channel(each): partial(self.pass_on, line) for each, line in commands.items()}
        )
        self._inside: Final = Bus(
            real, {report_channel(each): partial(self.pass_on, line) for each, line in reports.items()}
        )
        self._outside.listen("lcm-relay")
        self._inside.listen("lcm-relay")

    def close(self) -> None:
        super().close()
        self._outside.close()
        self._inside.close()

    def _say_inside(self, channel: str, message: bytes) -> None:
        self._inside.say(channel, message)

    def _say_outside(self, channel: str, message: bytes) -> None:
        self._outside.say(channel, message)
