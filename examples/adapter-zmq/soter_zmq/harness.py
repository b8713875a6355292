"""What SOTER's conformance kit needs to judge this adapter: its robots, behind a link that can be broken."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from soter.conformance.wire import WireHarness
from soter_zmq.adapter import ZmqBackend
from soter_zmq.relay import Relay


class ZmqHarness(WireHarness):
    """Opens simulated robots behind a relay."""

    name = "zmq"
    backend = ZmqBackend

    def impair(self, addresses: Mapping[int, Any]) -> Relay:
        return Relay(addresses)
