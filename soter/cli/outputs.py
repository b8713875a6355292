"""Files that a command writes: refused before the run if they cannot be written, and never seen half written."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Final

import typer

from soter.cli.exits import ExitCode, complain
from soter.errors import ConfigError, option_error

_TO_STDOUT: Final = ("--json", "--junit")
"""Options whose file may be `-`."""
_DRAWN: Final = {
    "--picture": (".png", "soter.report.picture"),
    "--png": (".png", "soter.report.picture"),
    "--gif": (".gif", "soter.report.film"),
    "--mp4": (".mp4", "soter.report.mp4"),
    "--still": (".png", "soter.cli.still"),
}
"""Options for pictures and films: ending of the file's name, and library that draws it."""


class Output:
    """A file to write once at the end, or repeatedly.

    Raises:
        ConfigError: the file cannot be written.
    """

    def __init__(self, path: Path, option: str) -> None:
        self.path: Final = path
        self._option: Final = option
        # The file behind a link is replaced, not the link.
        self._target: Final = path.resolve()
        self._replaces = is_there(self._target)
        self._part: Final = self._target.parent / f".{self._target.name}.{os.getpid()}.part"
        self._try()

    def write(self, data: bytes) -> None:
        """Write the file as a whole or not at all. A file that was made there meanwhile is not replaced.

        Raises:
            OSError: the file cannot be written after all.
        """
        if not self.replaceable:
            self._target.write_bytes(data)
            return
        try:
            self._part.write_bytes(data)
            if self._replaces:
                self._part.replace(self._target)
            else:
                appear(self._part, self._target)
                # From now on the file is this command's own.
                self._replaces = True
        except OSError:
            self._part.unlink(missing_ok=True)
            raise

    @property
    def replaceable(self) -> bool:
        """Whether writing again replaces the content, as in files, instead of appending to it, as in pipes."""
        return not self._target.exists() or self._target.is_file()

    def _try(self) -> None:
        try:
            if str(self.path) == "-":
                raise self._refusal("it does not go to standard output; name a file")
            if self._target.is_dir():
                raise self._refusal("it is a folder; name a file in it")
            if not self._target.parent.is_dir():
                raise self._refusal(f"there is no folder '{self.path.parent}'; make it first")
            if self._target.exists() and not os.access(self._target, os.W_OK):
                raise self._refusal("it may not be written")
            if self.replaceable:
                # Only making a file shows whether the folder takes one: permissions do not tell everything.
                self._part.touch()
                self._part.unlink()
        except OSError as failure:
            raise self._refusal(failure.strerror or str(failure)) from failure

    def _refusal(self, why: str) -> ConfigError:
        return option_error(self._option, f"'{self.path}' cannot be written: {why}")


class StandardOutput:
    """Standard output, as a file to be written at the end."""

    replaceable: Final = False

    def write(self, data: bytes) -> None:
        """Write the data, and an end of line."""
        sys.stdout.write(data.decode())
        sys.stdout.flush()


def is_there(path: Path) -> bool:
    """Return whether a path exists; False for impossible names."""
    return os.path.exists(path)  # noqa: PTH110 - Path.exists() raises for a name that is too long


def appear(part: Path, target: Path) -> None:
    """Rename a file to its final name, unless another file has that name by now.

    Raises:
        FileExistsError: another file has the name.
        OSError: the file cannot be renamed.
    """
    try:
        target.hardlink_to(part)
    except FileExistsError:
        raise
    except OSError:
        # The file system has no links.
        part.replace(target)
    else:
        part.unlink()


def refuse_clashes(outputs: Mapping[str, Path | None], inputs: Iterable[Path] = (), *, force: bool = False) -> None:
    """Refuse to overwrite a file that exists, that two options name, or that the command reads.

    Args:
        outputs: files by option; None if not given. Pipes and devices may be named twice, and - is standard output.
        inputs: the files that the command reads.
        force: whether existing files may be replaced.

    Raises:
        ConfigError: names the option and the other use of the file.
    """
    taken = {path.resolve(): "the command reads it" for path in inputs}
    for option, path in outputs.items():
        if path is None or str(path) == "-":
            continue
        target = path.resolve()
        try:
            # Unlike `is_there`, this raises for an impossible name.
            if target.exists() and not target.is_file():
                continue
        except OSError as failure:
            raise option_error(option, f"'{path}' cannot be written: {failure.strerror}") from failure
        if target in taken:
            raise option_error(option, f"'{path}' would be overwritten: {taken[target]}; name another file")
        taken[target] = f"{option} names it too"
        if is_there(target) and not force:
            raise option_error(option, f"'{path}' is there already; name another file, or give --force to replace it")


@contextmanager
def unwritten(what: str) -> Iterator[None]:
    """If something cannot be written, print a message and exit with `ExitCode.RUN_FAILED`."""
    try:
        yield
    except OSError as failure:
        complain(f"{what} could not be written: {failure}")
        raise typer.Exit(ExitCode.RUN_FAILED) from failure


class Outputs:
    """The output files of a command, by option: `--json` with a path or `-`, `--picture` with a PNG, and others.

    Attributes:
        files: the given files, by option.

    Raises:
        ConfigError: a file cannot be written, has another ending, lacks the library to draw it, or would overwrite
            another one; see `refuse_clashes`.
    """

    def __init__(self, given: Mapping[str, Path | None], inputs: Iterable[Path] = (), *, force: bool = False) -> None:
        refuse_clashes(given, inputs, force=force)
        self.files: Final = {option: _opened(option, path) for option, path in given.items() if path is not None}

    @property
    def to_stdout(self) -> bool:
        """Whether one of the files is standard output, which must then get nothing else."""
        return any(isinstance(file, StandardOutput) for file in self.files.values())

    def write(self, option: str, make: Callable[[], bytes]) -> None:
        """Make the content of an option's file and write it, if the option was given.

        Raises:
            OSError: the file cannot be written after all.
        """
        if option in self.files:
            self.files[option].write(make())


def _opened(option: str, path: Path) -> Output | StandardOutput:
    if option in _TO_STDOUT and str(path) == "-":
        return StandardOutput()
    suffix, drawn_by = _DRAWN.get(option, ("", ""))
    if suffix and path.suffix.lower() != suffix:
        raise option_error(option, f"'{path}' does not end in {suffix}; it is written as {suffix[1:].upper()}")
    output = Output(path, option)
    try:
        if drawn_by:
            import_module(drawn_by)
    except ImportError as failure:
        from soter.registry import install_hint

        library = (failure.name or "matplotlib").partition(".")[0]
        raise option_error(
            option,
            f"it is drawn with {library}, which cannot be imported ({failure}); install it with: "
            f"{install_hint(library)}",
        ) from failure
    return output


def as_json(content: object, *, allow_nan: bool = False) -> bytes:
    """Return content as JSON that people can read, too."""
    return f"{json.dumps(content, indent=2, allow_nan=allow_nan, default=str)}\n".encode()
