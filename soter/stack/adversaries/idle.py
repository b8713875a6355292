"""Adversaries that do nothing: one for ever, one by failing."""

from __future__ import annotations

from soter.stack.adversaries.base import Adversary, AdversaryOptions


class Frozen(Adversary[AdversaryOptions]):
    """Never sends anything. Its robots stand where they are, and go home when their batteries say so."""

    def act(self, now_s: float, tick: int) -> None:
        """Nothing."""


class Raises(Adversary[AdversaryOptions]):
    """Fails at once and for good: its robots belong to their safe controllers from the first tick on."""

    def act(self, now_s: float, tick: int) -> None:
        """Fail.

        Raises:
            RuntimeError: always.
        """
        raise RuntimeError("this adversary always fails")
