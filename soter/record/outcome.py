"""What the writer of a recording says when it ends."""

from __future__ import annotations

from msgspec import Struct


class Outcome(Struct):
    """How the writing went.

    Attributes:
        failure: why the recording is not complete; empty if it is.
        size_bytes: of the file.
    """

    failure: str = ""
    size_bytes: int = 0
