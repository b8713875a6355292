"""What the writer of a recording is told when it starts, and says when it ends."""

from __future__ import annotations

from msgspec import Struct


class Task(Struct):
    """How to write.

    Attributes:
        nice: whether the run does not wait for the writer, and is not to be held up by it.
        part: the file that is written.
        target: the file that it replaces when it is complete; None for none.
        sign: the private key to sign it with; None for none.
    """

    nice: bool
    part: str
    target: str | None = None
    sign: str | None = None


class Outcome(Struct):
    """How the writing went.

    Attributes:
        failure: why the recording is not complete; empty if it is.
        size_bytes: of the file.
    """

    failure: str = ""
    size_bytes: int = 0
