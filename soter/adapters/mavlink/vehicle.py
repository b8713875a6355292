"""One vehicle on a link: what is known of it, and commands with their answers."""

from __future__ import annotations

import re
from collections import deque
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.adapters.mavlink.link import AUTOPILOT, Fields, Link
from soter.adapters.mavlink.modes import Kind, kind_of

_SAID_KEPT: Final = 6
_WORST_SEVERITY: Final = mav.MAV_SEVERITY_WARNING
_FRESH_S: Final = 3.0
_EVERYBODY: Final = 0

_UNREADY_EKF: Final = mav.EKF_CONST_POS_MODE | mav.EKF_UNINITIALIZED
_READY_EKF: Final = (
    mav.EKF_ATTITUDE | mav.EKF_VELOCITY_HORIZ | mav.EKF_VELOCITY_VERT | mav.EKF_POS_HORIZ_REL | mav.EKF_POS_HORIZ_ABS
    | mav.EKF_POS_VERT_ABS | mav.EKF_PRED_POS_HORIZ_REL | mav.EKF_PRED_POS_HORIZ_ABS
)  # fmt: skip
"""831: everything that navigation needs. The first position comes long before that, and may be far off."""

_RESULTS: Final = {value: entry.name.removeprefix("MAV_RESULT_") for value, entry in mav.enums["MAV_RESULT"].items()}


class Ack(NamedTuple):
    """An answer to a command.

    Attributes:
        result: a MAV_RESULT.
        received_s: steady time at which it came.
    """

    result: int
    received_s: float

    @property
    def accepted(self) -> bool:
        """Whether the vehicle does it."""
        return self.result in (mav.MAV_RESULT_ACCEPTED, mav.MAV_RESULT_IN_PROGRESS)

    @property
    def name(self) -> str:
        """The result as MAVLink calls it."""
        return _RESULTS.get(self.result, f"result {self.result}")


class Vehicle:
    """One vehicle. The receiving thread calls the hooks; all else belongs to the supervisor's thread.

    Args:
        link: over which it is reached.
        system: its system id.

    Attributes:
        inbox: what it has said.
    """

    def __init__(self, link: Link, system: int) -> None:
        self.link: Final = link
        self.system: Final = system
        self.inbox: Final = link.inboxes[system]
        self._acks: Final[dict[int, Ack]] = {}
        self._said: Final[deque[tuple[float, str]]] = deque(maxlen=_SAID_KEPT)
        self._kind: Kind | None = None
        self.inbox.hooks["COMMAND_ACK"] = self._hear_ack
        self.inbox.hooks["STATUSTEXT"] = self._hear_text

    # --- the receiving thread ------------------------------------------------------------------------------

    def _hear_ack(self, message: Any, received_s: float) -> None:
        # Others may talk to it over the same link.
        if message.target_system in (_EVERYBODY, self.link.system):
            self._acks[message.command] = Ack(message.result, received_s)

    def _hear_text(self, message: Any, received_s: float) -> None:
        if message.severity <= _WORST_SEVERITY:
            text = message.text
            plain = text.decode("utf-8", "replace") if isinstance(text, bytes) else str(text)
            # It is shown to people: nothing of it may move their cursor.
            self._said.append((received_s, re.sub(r"[^ -~]", "?", plain)))

    # --- what is known -------------------------------------------------------------------------------------

    @property
    def now_s(self) -> float:
        """Steady time."""
        return self.link.clock.steady_s()

    def heard_since(self, name: str, since_s: float) -> Any | None:
        """Return the latest message of a kind if it was received at or after a steady time, else None."""
        heard = self.inbox.latest.get(name)
        return heard.message if heard is not None and heard.received_s >= since_s else None

    @property
    def heartbeat(self) -> Any | None:
        """The latest HEARTBEAT; None if the last one is too old to say anything."""
        return self.heard_since("HEARTBEAT", self.now_s - _FRESH_S)

    @property
    def kind(self) -> Kind:
        """What it is, by its HEARTBEAT, of which one must have been heard.

        Raises:
            RobotUnavailable: it is nothing that this adapter can command.
        """
        if self._kind is None:
            heartbeat = self.inbox.latest["HEARTBEAT"].message
            self._kind = kind_of(heartbeat.type, heartbeat.autopilot)
        return self._kind

    @property
    def mode(self) -> int | None:
        """Its mode, as its HEARTBEAT says; None while it is not heard."""
        heartbeat = self.heartbeat
        return None if heartbeat is None else int(heartbeat.custom_mode)

    @property
    def armed(self) -> bool:
        """Whether its motors may turn, as its HEARTBEAT says."""
        heartbeat = self.heartbeat
        return heartbeat is not None and bool(heartbeat.base_mode & mav.MAV_MODE_FLAG_SAFETY_ARMED)

    def ekf_ready(self, since_s: float) -> bool:
        """Return whether its position can be trusted, by what it has said since a steady time."""
        report = self.heard_since("EKF_STATUS_REPORT", since_s) or self.heard_since("ESTIMATOR_STATUS", since_s)
        if report is None:
            return False
        return report.flags & _READY_EKF == _READY_EKF and not report.flags & _UNREADY_EKF

    def ack(self, command: int, since_s: float) -> Ack | None:
        """Return the answer to a command that came at or after a steady time, or None."""
        ack = self._acks.get(command)
        return ack if ack is not None and ack.received_s >= since_s else None

    def parameter(self, name: str, since_s: float) -> float | None:
        """Return a parameter's value if the vehicle has told it since a steady time, as the last one, else None."""
        said = self.heard_since("PARAM_VALUE", since_s)
        return said.param_value if said is not None and said.param_id.rstrip("\0") == name else None

    def complaints(self, since_s: float) -> str:
        """Return what the autopilot has complained of since a steady time, each thing once; empty for nothing."""
        return "; ".join(dict.fromkeys(text for at_s, text in tuple(self._said) if at_s >= since_s))

    # --- what it is told -----------------------------------------------------------------------------------

    def send(self, component: int, name: str, fields: Fields) -> None:
        """Send a message in the name of one of our components."""
        self.link.send(self.system, component, name, fields)

    def command(self, component: int, command: int, *params: float) -> None:
        """Send a command, always to this vehicle's autopilot: a broadcast would be executed by everybody."""
        values = [*params, *[0.0] * (7 - len(params))]
        self.send(component, "COMMAND_LONG", {
            "target_system": self.system, "target_component": AUTOPILOT, "command": command, "confirmation": 0,
            **{f"param{number}": value for number, value in enumerate(values, start=1)},
        })  # fmt: skip

    def ask_for(self, component: int, message_id: int, hz: float) -> None:
        """Ask for a message so many times a second."""
        self.command(component, mav.MAV_CMD_SET_MESSAGE_INTERVAL, float(message_id), 1e6 / hz)

    def ask_once(self, component: int, message_id: int) -> None:
        """Ask for a message once."""
        self.command(component, mav.MAV_CMD_REQUEST_MESSAGE, float(message_id))

    def set_parameter(self, component: int, name: str, value: int) -> None:
        """Set a parameter that is a whole number."""
        self.send(component, "PARAM_SET", {
            "target_system": self.system, "target_component": AUTOPILOT, "param_id": name,
            "param_value": float(value), "param_type": mav.MAV_PARAM_TYPE_INT32,
        })  # fmt: skip

    def set_mode(self, component: int, mode: int) -> None:
        """Ask for a mode."""
        self.command(component, mav.MAV_CMD_DO_SET_MODE, *self.kind.mode_params(mode))
