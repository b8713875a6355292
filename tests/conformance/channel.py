"""One direction of a simulated link in virtual time, and what is wrong with it."""

from __future__ import annotations

import random
from dataclasses import dataclass
from typing import Generic, TypeVar

M = TypeVar("M")

LATE_S = 0.12
"""How much later a reordered message comes."""


@dataclass
class Faults:
    """What is wrong with a link."""

    cut: bool = False
    gone: bool = False
    delay_s: float = 0.0
    loss: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    garble: float = 0.0


class Channel(Generic[M]):
    """One direction of a link.

    Attributes:
        arrived_s: by what was handed out, when it had arrived.
        stray: how many messages that make no sense came between the others, which is all that is known of them.
    """

    def __init__(self, faults: Faults, seed: int) -> None:
        self.faults = faults
        self.arrived_s: dict[int, float] = {}
        self.stray = 0
        self._random = random.Random(seed)
        self._flying: list[tuple[float, M]] = []

    def send(self, now_s: float, message: M) -> None:
        self._require_peer()
        faults, draw = self.faults, self._random.random
        if faults.cut or draw() < faults.loss:
            return
        self.stray += draw() < faults.garble
        for _ in range(2 if draw() < faults.duplicate else 1):
            late_s = LATE_S if draw() < faults.reorder else 0.0
            self._flying.append((now_s + faults.delay_s + late_s, message))

    def receive(self, now_s: float) -> list[M]:
        """Return what has arrived, earliest first."""
        self._require_peer()
        if self.faults.cut:
            self._flying.clear()
        due = sorted((each for each in self._flying if each[0] <= now_s + 1e-6), key=lambda each: each[0])
        self._flying = [each for each in self._flying if each[0] > now_s + 1e-6]
        self.arrived_s = {id(message): at_s for at_s, message in due}
        return [message for _, message in due]

    def _require_peer(self) -> None:
        if self.faults.gone:
            self._flying.clear()
            raise ConnectionRefusedError("nobody is at the other end")
