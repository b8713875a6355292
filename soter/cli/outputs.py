"""Files that a command writes: refused before the run if they cannot be written, and never seen half written."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

from soter.errors import ConfigError


class Output:
    """A file to be written at the end.

    Args:
        path: where.
        option: the option that named it, for messages.

    Raises:
        ConfigError: it cannot be written there.
    """

    def __init__(self, path: Path, option: str) -> None:
        self.path: Final = path
        self._option: Final = option
        # The file behind a link is replaced, not the link.
        self._target: Final = path.resolve()
        self._part: Final = self._target.with_name(f".{self._target.name}.{os.getpid()}.part")
        self._try()

    def write(self, data: bytes) -> None:
        """Write the file as a whole, or leave what was there before.

        Raises:
            OSError: it cannot be written after all.
        """
        if self._special():
            self._target.write_bytes(data)
            return
        try:
            self._part.write_bytes(data)
            self._part.replace(self._target)
        except OSError:
            self._part.unlink(missing_ok=True)
            raise

    def _special(self) -> bool:
        """Whether it is a pipe or a device, which is written to and not replaced."""
        return self._target.exists() and not self._target.is_file()

    def _try(self) -> None:
        try:
            if self._target.is_dir():
                raise self._refusal("it is a folder; name a file in it")
            if not self._target.parent.is_dir():
                raise self._refusal(f"there is no folder '{self.path.parent}'; make it first")
            if self._target.exists() and not os.access(self._target, os.W_OK):
                raise self._refusal("it may not be written")
            if not self._special():
                # Whether a folder takes files is only known from making one: rights are not all there is to it.
                self._part.touch()
                self._part.unlink()
        except OSError as failure:
            raise self._refusal(failure.strerror or str(failure)) from failure

    def _refusal(self, why: str) -> ConfigError:
        return ConfigError(f"'{self.path}' cannot be written: {why}", source="command line", key=self._option)


class StandardOutput:
    """Standard output, as a file to be written at the end."""

    def write(self, data: bytes) -> None:
        """Write the data, and an end of line."""
        sys.stdout.write(data.decode())
        sys.stdout.flush()


def refuse_clashes(outputs: Mapping[str, Path | None], inputs: Iterable[Path] = ()) -> None:
    """Refuse what would be lost: a file that two options name, or one that the command reads.

    Args:
        outputs: by option; None means not given. Pipes and devices may be named twice.
        inputs: the files that the command reads.

    Raises:
        ConfigError: names the option and what the file is already.
    """
    taken = {path.resolve(): "the command reads it" for path in inputs}
    for option, path in outputs.items():
        if path is None:
            continue
        target = path.resolve()
        if target.exists() and not target.is_file():
            continue
        if target in taken:
            raise ConfigError(
                f"'{path}' would be overwritten: {taken[target]}; name another file", source="command line", key=option
            )
        taken[target] = f"{option} names it too"


def json_output(path: Path) -> Output | StandardOutput:
    """Return where `--json` goes; `-` is standard output.

    Raises:
        ConfigError: it cannot be written there.
    """
    return StandardOutput() if str(path) == "-" else Output(path, "--json")


def picture_output(path: Path, option: str = "--picture", suffix: str = ".png") -> Output:
    """Return where a picture goes.

    Args:
        path: where.
        option: the option that named it, for messages.
        suffix: of its kind, lower case.

    Raises:
        ConfigError: it cannot be written there, it is of another kind, or there is nothing to draw it with.
    """
    if path.suffix.lower() != suffix:
        raise ConfigError(
            f"'{path}' does not end in {suffix}; it is written as {suffix[1:].upper()}",
            source="command line",
            key=option,
        )
    output = Output(path, option)
    try:
        import soter.report.picture  # noqa: F401 - only whether it can be imported
    except ImportError as failure:
        from soter.registry import install_hint

        raise ConfigError(
            f"pictures are drawn with matplotlib, which cannot be imported ({failure}); install it with: "
            f"{install_hint('matplotlib')}",
            source="command line",
            key=option,
        ) from failure
    return output
