"""The messages between SOTER and the mux, JSON in std_msgs/String; and readers for messages of any format.

Standard library only.

An order is no event but the whole state that is to hold, with a number: the next order makes good for a lost one, and a
double or late one is known by its number.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

from soter.controller import Controller

AC: Final = Controller.AC.value
SC: Final = Controller.SC.value
CONTROLLERS: Final = (AC, SC)

CMD_VEL: Final = "cmd_vel"
CMD_VEL_AC: Final = "cmd_vel_ac"
CMD_VEL_SC: Final = "cmd_vel_sc"
ORDER: Final = "soter/order"
GATE: Final = "soter/gate"

MOST_BYTES: Final = 2048
"""Longest message. Longer ones are not parsed, which bounds every number, text and depth in a message."""

SEQ_MOST: Final = 2**53
"""Largest number of an order: up to here every reader of JSON has whole numbers exactly."""

_TEXT_LENGTH: Final = 64
"""Longest name of a session or of a clock: reports repeat the names, and must fit a message for any order."""

_MOST: Final = 1e11
_SHOWN: Final = 80


class Order(NamedTuple):
    """The active controller of a robot, and its lease.

    Attributes:
        session: name of the program that gives orders; a mux follows one at a time.
        seq: grows with each order of a session, a whole number from 0 to `SEQ_MOST`.
        controller: the active controller, "AC" or "SC".
        renewed_s: time of the lease's renewal, by the sender's knowledge of the robot's clock; None ends the lease.
    """

    session: str
    seq: int
    controller: str
    renewed_s: float | None

    def encode(self) -> str:
        """Return the text of the message."""
        return json.dumps(self._asdict())

    @staticmethod
    def decode(text: str | bytes) -> Order:
        """Return the order in a text. The cost is bounded for any text.

        Raises:
            ValueError: the text holds no order; nothing else is ever raised.
        """
        values = read_object(text)
        return Order(
            read_text(values, "session"), read_count(values, "seq"), read_controller(values),
            read_optional(values, "renewed_s", "a number of seconds"),
        )  # fmt: skip


class GateReport(NamedTuple):
    """A mux's state, sent whenever it takes an order, or begins or stops passing commands.

    Attributes:
        session: the session that the mux follows; empty before the first order.
        seq: the number of the last order.
        controller: the active controller, "AC" or "SC".
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
    def decode(text: str | bytes) -> GateReport:
        """Return the report in a text. The cost is bounded for any text.

        Raises:
            ValueError: the text holds no report; nothing else is ever raised.
        """
        return GateReport.read(read_object(text))

    @staticmethod
    def read(values: Mapping[str, Any]) -> GateReport:
        """Return a report that is part of another message, or raise ValueError."""
        return GateReport(
            read_text(values, "session"), read_count(values, "seq"), read_controller(values),
            values.get("alive") is True,
        )  # fmt: skip


# --- readers of messages -----------------------------------------------------------------------------------


def read_object(text: str | bytes) -> dict[str, Any]:
    """Return the JSON object in a text, at a bounded cost.

    Raises:
        ValueError: the text holds no object; nothing else is ever raised.
    """
    if len(text) > MOST_BYTES:
        raise ValueError(f"{len(text)} characters, allowed: at most {MOST_BYTES}")
    try:
        values = json.loads(text.decode() if isinstance(text, bytes) else text)
    except RecursionError as failure:
        raise ValueError(f"nested too deeply: {_shown(text)}") from failure
    return as_object(values)


def as_object(value: object) -> dict[str, Any]:
    """Return a value if it is a JSON object, or raise ValueError."""
    if not isinstance(value, dict):
        raise ValueError(f"not an object: {_shown(value)}")  # noqa: TRY004 - bad input, whatever its type
    return value


def read_text(values: Mapping[str, Any], name: str) -> str:
    """Return a short text, empty if absent, or raise ValueError."""
    text = values.get(name, "")
    if not isinstance(text, str) or len(text) > _TEXT_LENGTH:
        raise ValueError(f"{name} is {_shown(text)}, allowed: a text of at most {_TEXT_LENGTH} characters")
    return text


def read_count(values: Mapping[str, Any], name: str) -> int:
    """Return a whole number from 0 to `SEQ_MOST`, or raise ValueError."""
    count = values.get(name)
    if isinstance(count, bool) or not isinstance(count, int) or not 0 <= count <= SEQ_MOST:
        raise ValueError(f"{name} is {_shown(count)}, allowed: a whole number from 0 to {SEQ_MOST}")
    return count


def read_controller(values: Mapping[str, Any], name: str = "controller") -> str:
    """Return "AC" or "SC", or raise ValueError."""
    value = values.get(name)
    if value not in CONTROLLERS:
        raise ValueError(f"{name} is {_shown(value)}, allowed: {' or '.join(CONTROLLERS)}")
    return str(value)


def read_number(values: Mapping[str, Any], name: str, what: str = "a number") -> float:
    """Return a number from -1e11 to 1e11, or raise ValueError."""
    value = values.get(name)
    # Python's JSON reader takes NaN, Infinity and integers too large for a float; the bounds refuse all of them.
    if isinstance(value, bool) or not isinstance(value, int | float) or not -_MOST <= value <= _MOST:
        raise ValueError(f"{name} is {_shown(value)}, allowed: {what}, at most {_MOST:g}")
    return float(value)


def read_optional(values: Mapping[str, Any], name: str, what: str = "a number") -> float | None:
    """Return a number as `read_number` does, or None if the field is absent or null."""
    return None if values.get(name) is None else read_number(values, name, what)


def _shown(value: object) -> str:
    return repr(value)[:_SHOWN]
