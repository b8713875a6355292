"""Recorded robots, which repeat their samples and answers, and execute no commands."""

from __future__ import annotations

import math
from typing import Any, ClassVar, Final, NoReturn

from soter.clock import Clock
from soter.record.about import capabilities_of
from soter.record.attachments import RobotAbout
from soter.record.messages import PeerEvent, RobotTick, StateMessage
from soter.record.samples import sample_of
from soter.rta import Assumption, Sample
from soter.rta.monitors import BrokenAssumption
from soter.sdk import Capabilities, Controller, Robot, RobotSpec, RobotState
from soter.stack.actuator import RobotActuator

_ASSUMPTIONS: Final = {each.id: each for each in Assumption}


class RecordedFailure(Exception):
    """A recorded failure, raised again; its text is that of the original exception."""

    def __repr__(self) -> str:
        return str(self)


class RecordedActuator:
    """An `Actuator` that repeats the recorded one's samples and failures, and passes no command on.

    Args:
        inner: the actuator of the recorded robot, for answers that follow from a sample alone.
        start: the sample before the first tick.
        obeys: whether the replay repeats the recorded commands; if not, the recorded active controller is ignored.
    """

    def __init__(self, inner: RobotActuator, start: RobotState, *, obeys: bool) -> None:
        self._inner: Final = inner
        self._obeys: Final = obeys
        self._sample = start
        self._failure: str | None = None
        self._refused: list[tuple[str, str]] = []

    def load(self, record: RobotTick) -> None:
        """Take the record of the next tick."""
        self._failure = record.no_state if record.unread else None
        self._refused = [(each.call, each.failure) for each in record.refused]
        sample = sample_of(record.state, record.robot_id)
        # As in the run, an unchanged sample is the same object.
        if sample != self._sample:
            self._sample = sample

    def read(self) -> Sample:
        if self._failure is not None:
            raise RecordedFailure(self._failure)
        return self._sample

    def drive(self, command: Any, mode: Controller) -> None:
        self._fail("drive")

    def hand_over(self, mode: Controller, module: str, cause: str) -> None:
        self._fail("hand_over")

    def renew(self) -> None:
        self._fail("renew")

    def reported(self, sample: Sample) -> Controller | None:
        return self._inner.reported(sample) if self._obeys else None

    def insist(self) -> None:
        self._fail("insist")

    def _fail(self, call: str) -> None:
        for each in self._refused:
            if each[0] == call:
                self._refused.remove(each)
                raise RecordedFailure(each[1])


class RecordedPeer:
    """A `RemotePeer` that repeats its recorded answers."""

    def __init__(self, robot_id: int) -> None:
        self.robot_id = robot_id
        self._said = PeerEvent(0.0, robot_id)
        self._sample: Sample | None = None

    def load(self, said: PeerEvent) -> None:
        """Take the event of the next tick."""
        self._said = said
        self._sample = sample_of(said.state, self.robot_id) if isinstance(said.state, StateMessage) else None

    def sample(self) -> Sample | None:
        return self._sample

    def heard_of(self, robot_id: int) -> float:
        return next((each.stamp_s for each in self._said.heard if each.robot_id == robot_id), -math.inf)

    def needs_charge(self) -> bool:
        return self._said.needs_charge

    def found(self) -> BrokenAssumption | None:
        said = self._said
        return BrokenAssumption(_ASSUMPTIONS[said.assumption], said.cause) if said.assumption in _ASSUMPTIONS else None


class RecordedRobot(Robot, overrides=("capabilities",)):
    """A robot with recorded promises, which refuses all commands.

    Raises:
        ValueError: the promises are not those of this version.
    """

    declared: ClassVar[Capabilities]

    def __init__(self, about: RobotAbout, clock: Clock) -> None:
        state = about.initial
        super().__init__(RobotSpec(about.robot_id, state.x_m, state.y_m, state.heading_rad), clock)
        self._promises: Final = capabilities_of(about)

    @property
    def capabilities(self) -> Capabilities:
        return self._promises

    def _refuse(self, *_: object, **__: object) -> NoReturn:
        raise RuntimeError(f"robot {self.id} is recorded and takes no orders")

    _connect = _send_goto = _sample = _hand_over = _renew_lease = _halt = _disconnect = _refuse
