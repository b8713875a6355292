"""What SOTER and the mux tell each other: JSON in std_msgs/String. Standard library only.

An order is not an event but all that is to hold, numbered: one that is lost is made good by the next, one that comes
twice or too late is known by its number.
"""

from __future__ import annotations

import json
import math
from typing import Any, Final, NamedTuple

AC: Final = "AC"
SC: Final = "SC"
CONTROLLERS: Final = (AC, SC)

CMD_VEL: Final = "cmd_vel"
CMD_VEL_AC: Final = "cmd_vel_ac"
CMD_VEL_SC: Final = "cmd_vel_sc"
ORDER: Final = "soter/order"
GATE: Final = "soter/gate"


class Order(NamedTuple):
    """Who is in charge of a robot, and until when.

    Attributes:
        session: names the program that gives orders; a mux follows one at a time.
        seq: grows with each order of a session.
        controller: who is in charge, "AC" or "SC".
        renewed_s: the robot's time at which the lease was renewed, as far as the sender knows it; None ends the lease.
    """

    session: str
    seq: int
    controller: str
    renewed_s: float | None

    def encode(self) -> str:
        """Return the text of the message."""
        return json.dumps(self._asdict())

    @staticmethod
    def decode(text: str) -> Order:
        """Read an order.

        Raises:
            ValueError: it is none.
        """
        values = _object(text)
        renewed_s = values.get("renewed_s")
        return Order(
            _session(values), _seq(values), _controller(values),
            None if renewed_s is None else _number(renewed_s, "renewed_s"),
        )  # fmt: skip


class GateReport(NamedTuple):
    """What a mux does, told whenever it takes an order or stops passing one.

    Attributes:
        session: whose orders it follows; empty before the first.
        seq: the last order it took.
        controller: who is in charge, "AC" or "SC".
        alive: whether the lease lives.
    """

    session: str
    seq: int
    controller: str
    alive: bool

    def encode(self) -> str:
        """Return the text of the message."""
        return json.dumps(self._asdict())

    @staticmethod
    def decode(text: str) -> GateReport:
        """Read a report.

        Raises:
            ValueError: it is none.
        """
        values = _object(text)
        return GateReport(_session(values), _seq(values), _controller(values), values.get("alive") is True)


def _object(text: str) -> dict[str, Any]:
    values = json.loads(text)
    if not isinstance(values, dict):
        raise ValueError(f"not an object: {text[:80]!r}")  # noqa: TRY004 - bad input, whatever its type
    return values


def _session(values: dict[str, Any]) -> str:
    return str(values.get("session", ""))


def _seq(values: dict[str, Any]) -> int:
    return int(_number(values.get("seq"), "seq"))


def _controller(values: dict[str, Any]) -> str:
    value = values.get("controller")
    if value not in CONTROLLERS:
        raise ValueError(f"controller is {value!r}, allowed: {' or '.join(CONTROLLERS)}")
    return str(value)


def _number(value: object, name: str) -> float:
    # JSON has no NaN, but Python's reader takes it.
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{name} is {value!r}, which is no number")
    return float(value)
