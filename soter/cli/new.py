"""`soter new`: writes packages to begin with."""

from __future__ import annotations

import keyword
import re
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Final

import typer

from soter.cli.exits import guard
from soter.cli.option import option
from soter.cli.plain import emit
from soter.errors import ConfigError

ADAPTER_EXAMPLES = """Examples:
  soter new adapter crawler
  soter new adapter crawler --out robots/crawler
Exit codes:
  0  the package is written
  2  the name will not do, or there is something in its place
"""

_TEMPLATES: Final = Path(__file__).parent / "new_adapter"
_SUFFIX: Final = ".in"
_PLACEHOLDER: Final = "template"

new = typer.Typer(
    name="new",
    help="Write a package to begin with.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


@new.command(epilog=ADAPTER_EXAMPLES)
def adapter(
    name: Annotated[str, typer.Argument(metavar="NAME", help="The backend's name: lower-case letters, digits and _.")],
    out: Annotated[
        Path | None, option("DIR", "The folder to write, new or empty; soter-NAME here if not given.")
    ] = None,
) -> None:
    """Write an adapter that runs and conforms: robots on UDP, simulated ones, tests. Then put your own robots in it."""
    with guard():
        check_name(name)
        folder = out or Path(f"soter-{name}")
        written = write_adapter(name, folder)
        emit(f"{folder} has {len(written)} files. Next:")
        emit("")
        emit(f"  pip install -e {folder}")
        emit(f"  soter conform {name}")
        emit("")
        emit(f"What is in it, and what to change, says {folder / 'README.md'}.")


def check_name(name: str) -> None:
    """Check that a name can be a backend's, and part of a package's and of a class's.

    Raises:
        ConfigError: the name cannot be used.
    """
    from soter.registry import BUILT_IN

    if not re.fullmatch(r"[a-z][a-z0-9]*(_[a-z0-9]+)*", name) or keyword.iskeyword(name):
        raise ConfigError(f"NAME is '{name}', allowed: lower-case letters, digits and single _, such as my_robot")
    if name in BUILT_IN:
        raise ConfigError(
            f"NAME is '{name}', which is a backend of SOTER's own, allowed: none of {', '.join(BUILT_IN)}"
        )


def write_adapter(name: str, folder: Path) -> list[Path]:
    """Write the package of an adapter into a new or empty folder, and return its files.

    Raises:
        ConfigError: the path is not free, or the folder cannot be written; then no file is left in it.
    """
    written: list[Path] = []
    try:
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise ConfigError(f"there is something at '{folder}' already; name a new folder with --out")
        for source in sorted(_TEMPLATES.rglob(f"*{_SUFFIX}")):
            path = folder / _filled(str(source.relative_to(_TEMPLATES)).removesuffix(_SUFFIX), name)
            written.append(path)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(_filled(source.read_text(encoding="utf-8"), name), encoding="utf-8")
    except OSError as failure:
        # Leave the folder new or empty as it was, so that the command can be repeated.
        for path in written:
            with suppress(OSError):
                path.unlink(missing_ok=True)
                for parent in path.relative_to(folder).parents:
                    (folder / parent).rmdir()
        raise ConfigError(f"'{folder}' cannot be written: {failure}") from failure
    return written


def _filled(text: str, name: str) -> str:
    capitalised = "".join(word.capitalize() for word in name.split("_"))
    return text.replace(_PLACEHOLDER.capitalize(), capitalised).replace(_PLACEHOLDER, name)
