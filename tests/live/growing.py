"""Recordings that grow when a test says so."""

from __future__ import annotations

from pathlib import Path


class Growing:
    """A copy of a recording that is being written: from the beginning on, up to where it was told to go.

    Args:
        whole: the recording.
        path: of the copy.
    """

    def __init__(self, whole: Path, path: Path) -> None:
        self._data = whole.read_bytes()
        self._written = 0
        self.path = path
        path.touch()

    def to(self, part: float) -> None:
        """Write up to a part of the whole, from 0 to 1; it may end anywhere within a message."""
        until = round(part * len(self._data))
        with self.path.open("ab") as stream:
            stream.write(self._data[self._written : until])
        self._written = until
