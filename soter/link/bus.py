"""The bus between processes of one mission: keys and bytes, nothing promised. What must not get lost goes by a channel.

A bus is chosen by name, as backends are; the code that speaks a vendor's protocol lives in an adapter.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, Protocol, Self

from pydantic import BaseModel

Hear = Callable[[str, bytes], None]
"""Called with a key and what was published under it, in a thread of the bus; it must be quick and must not raise."""


class Bus(Protocol):
    """Carries small messages to everybody who subscribes to their key. Messages may be lost, late, doubled, reordered.

    Keys are names with slashes between, without a leading one: `soter/alpha/status`.

    Attributes:
        options_model: what `open` takes, checked where a mission is read.
    """

    options_model: ClassVar[type[BaseModel]]

    @classmethod
    def open(cls, options: Any) -> Self:
        """Open it; others may not be there yet, and may come and go.

        Args:
            options: an instance of `options_model`.

        Raises:
            BackendUnavailable: a library is missing.
            RobotUnavailable: it cannot be opened; the message says why, and what to do.
        """

    def publish(self, key: str, payload: bytes) -> None:
        """Send it to whoever subscribes. Never waits and never raises; where it cannot be sent, it is lost."""

    def subscribe(self, key: str, hear: Hear) -> None:
        """Hear what is published under a key from now on. A `*` stands for any one part of a key."""

    def close(self) -> None:
        """Leave. Nothing is heard afterwards. Idempotent."""
