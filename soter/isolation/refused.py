"""The message of a process of untrusted code that cannot start, and the error that it stands for."""

from __future__ import annotations

from typing import Annotated, Final, Literal, Self

import msgspec

from soter.errors import BackendError, BackendUnavailable, ConfigError, RunFailed, SoterError

MAX_LONG_TEXT: Final = 10_000

LongText = Annotated[str, msgspec.Meta(max_length=MAX_LONG_TEXT)]


class Refused(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True, tag="refused"):
    """The code for a process cannot be made: the error's kind and text, and the place of a `ConfigError`."""

    kind: Literal["config", "backend", "other"]
    message: LongText
    source: LongText | None = None
    line: int | None = None
    key: LongText | None = None

    @classmethod
    def of(cls, error: Exception) -> Self:
        """Return an error as a message."""
        if isinstance(error, ConfigError):
            source, key = (text if text is None else text[:MAX_LONG_TEXT] for text in (error.source, error.key))
            return cls("config", str(error)[:MAX_LONG_TEXT], source, error.line, key)
        if isinstance(error, BackendError):
            return cls("backend", str(error)[:MAX_LONG_TEXT])
        return cls("other", repr(error)[:MAX_LONG_TEXT])

    def error(self) -> SoterError:
        """Return the message as an error."""
        if self.kind == "config":
            error = ConfigError(self.message)  # the text includes its place already
            error.source, error.line, error.key = self.source, self.line, self.key
            return error
        return BackendUnavailable(self.message) if self.kind == "backend" else RunFailed(self.message)
