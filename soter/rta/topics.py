"""Topics (latest-value channels) and the periodic nodes that read and write them, as in figure 2.4 of the thesis."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Generic, TypeVar

from soter.rta.situation import Situation

T = TypeVar("T")


class Topic(Generic[T]):
    """A named channel that keeps its newest value and counts what was published.

    Attributes:
        name: unique within one robot.
        value: the newest value, or None before the first.
        count: number of values published so far; a reader that remembers it can tell whether the value is new.
    """

    __slots__ = ("count", "name", "value")

    def __init__(self, name: str) -> None:
        self.name = name
        self.value: T | None = None
        self.count = 0

    def __repr__(self) -> str:
        return f"Topic({self.name!r})"

    def publish(self, value: T | None) -> None:
        """Replace the value and count it."""
        self.value = value
        self.count += 1


class Node(ABC):
    """A periodic process: each step reads topics and the situation, and publishes.

    Attributes:
        name: its name in messages and recordings.
        period_s: time between two steps.
        subscribes: names of the topics that it reads.
        publishes: names of the topics that it writes.
    """

    name: str
    period_s: float
    subscribes: tuple[str, ...] = ()
    publishes: tuple[str, ...] = ()

    @abstractmethod
    def step(self, situation: Situation) -> None:
        """Do one period's work; never wait."""

    def engage(self, situation: Situation) -> None:
        """Forget what is left from an earlier time in control; called when this node takes control."""
