"""A bus in this process, in virtual time: it delays, loses, doubles, and is cut as a test says."""

from __future__ import annotations

import random
from collections.abc import Callable
from fnmatch import fnmatchcase
from typing import Any, ClassVar, Self

from pydantic import BaseModel

from soter.distribution.bus import Hear


class Network:
    """What carries messages. `advance` moves its time.

    Attributes:
        now_s: its time.
        delay_s: least and most of what a message takes.
        loss: how likely one is lost.
        cut: pairs of host names, from and to, between which nothing passes.
    """

    def __init__(self, seed: int = 0, delay_s: tuple[float, float] = (0.0, 0.0), loss: float = 0.0) -> None:
        self.now_s = 0.0
        self.delay_s = delay_s
        self.loss = loss
        self.cut: set[tuple[str, str]] = set()
        self.buses: list[MemoryBus] = []
        self.draw = random.Random(seed)
        self._under_way: list[tuple[float, int, MemoryBus, str, bytes]] = []
        self._count = 0

    def isolate(self, host: str, others: list[str]) -> None:
        """Cut a host off, in both directions."""
        self.cut |= {(host, other) for other in others} | {(other, host) for other in others}

    def send(self, sender: MemoryBus, key: str, payload: bytes) -> None:
        for bus in self.buses:
            if bus.host != sender.host and ((sender.host, bus.host) in self.cut or self.draw.random() < self.loss):
                continue
            self._count += 1
            arrives_s = self.now_s + self.draw.uniform(*self.delay_s)
            self._under_way.append((arrives_s, self._count, bus, key, payload))

    def advance(self, now_s: float) -> None:
        """Deliver what arrives up to a time, each at its own."""
        while due := [each for each in self._under_way if each[0] <= now_s]:
            first = min(due, key=lambda each: each[:2])
            self._under_way.remove(first)
            self.now_s = max(self.now_s, first[0])
            first[2].deliver(first[3], first[4])
        self.now_s = now_s


class NoOptions(BaseModel):
    """There are none."""


class MemoryBus:
    """One host's place in a network; hears itself too, as buses may."""

    options_model: ClassVar[type[BaseModel]] = NoOptions

    def __init__(self, network: Network, host: str) -> None:
        self.network, self.host = network, host
        self._subscriptions: list[tuple[str, Hear]] = []
        network.buses.append(self)

    @classmethod
    def open(cls, options: Any) -> Self:
        return cls(Network(), "nowhere")

    def publish(self, key: str, payload: bytes) -> None:
        if self in self.network.buses:
            self.network.send(self, key, payload)

    def subscribe(self, key: str, hear: Callable[[str, bytes], None]) -> None:
        self._subscriptions.append((key, hear))

    def deliver(self, key: str, payload: bytes) -> None:
        for wanted, hear in self._subscriptions:
            if self in self.network.buses and fnmatchcase(key, wanted):
                hear(key, payload)

    def close(self) -> None:
        if self in self.network.buses:
            self.network.buses.remove(self)
