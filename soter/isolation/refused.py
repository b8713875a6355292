"""What a process of untrusted code says when it cannot start, and the error that it stands for."""

from __future__ import annotations

from typing import Annotated, Final, Literal, Self

import msgspec

from soter.errors import BackendError, BackendUnavailable, ConfigError, RunFailed, SoterError

MAX_LONG_TEXT: Final = 10_000

LongText = Annotated[str, msgspec.Meta(max_length=MAX_LONG_TEXT)]


class Refused(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True, tag="refused"):
    """What is to run there cannot be made, and why: what the error says, and where a `ConfigError` is."""

    kind: Literal["config", "backend", "other"]
    message: LongText
    source: LongText | None = None
    line: int | None = None
    key: LongText | None = None

    @classmethod
    def of(cls, error: Exception) -> Self:
        """Return an error as it crosses."""
        if isinstance(error, ConfigError):
            source, key = (text if text is None else text[:MAX_LONG_TEXT] for text in (error.source, error.key))
            return cls("config", str(error)[:MAX_LONG_TEXT], source, error.line, key)
        if isinstance(error, BackendError):
            return cls("backend", str(error)[:MAX_LONG_TEXT])
        return cls("other", repr(error)[:MAX_LONG_TEXT])

    def error(self) -> SoterError:
        """Return the error that it stands for."""
        if self.kind == "config":
            error = ConfigError(self.message)  # which has its place in it already
            error.source, error.line, error.key = self.source, self.line, self.key
            return error
        return BackendUnavailable(self.message) if self.kind == "backend" else RunFailed(self.message)
