"""The files that a sandboxed process may read: Python, its libraries, and importable modules."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

_SYSTEM: Final = (
    "/usr", "/bin", "/sbin", "/lib", "/lib32", "/lib64", "/etc/ld.so.cache", "/etc/localtime", "/etc/timezone",
    "/etc/ssl/openssl.cnf", "/sys/devices/system/cpu", "/dev/null", "/dev/zero", "/dev/random", "/dev/urandom",
)  # fmt: skip
_IMPORTED: Final = (".py", ".pyc", ".so")


def readable(entries: Iterable[str], also: Iterable[str]) -> list[str]:
    """Return the files and folders that may be read."""
    libraries = os.environ.get("LD_LIBRARY_PATH", "").split(os.pathsep)
    found = [*_SYSTEM, sys.prefix, sys.base_prefix, sys.exec_prefix, sys.base_exec_prefix]
    found += [str(Path(sys.executable).resolve().parent.parent), *filter(None, libraries)]
    for each in (*entries, *also):
        found += _narrowed(Path(each).resolve()) if each else ()
    return list(dict.fromkeys(found))


def _narrowed(path: Path) -> Iterator[str]:
    """Yield a path; for a folder in the user's home or the folder for temporary files, yield only the modules in it."""
    private = (Path.home().resolve(), Path(tempfile.gettempdir()).resolve())
    if not any(path == each or path in each.parents for each in private):
        yield str(path)
        return
    try:
        inside = list(path.iterdir())
    except OSError:
        return
    for each in inside:
        if each.suffix in _IMPORTED or os.path.isfile(each / "__init__.py"):  # noqa: PTH113 - is_file() may raise
            yield str(each)
