"""Says what a change of the locks changes, which is what it has to be judged by: `make lock`."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Final

_LINE: Final = re.compile(r"^([a-z0-9._-]+)==([^\s;]+)(.*)$", re.MULTILINE)


def versions(folder: Path) -> dict[str, str]:
    """The version of every package in all locks of a folder, by its name and the marker behind it."""
    found = [line for lock in sorted(folder.glob("*.txt")) for line in _LINE.findall(lock.read_text(encoding="utf-8"))]
    return {name + marker: version for name, version, marker in found}


def report(before: dict[str, str], after: dict[str, str]) -> list[str]:
    """A line for each package that is new, gone or of another version, and one that counts them."""
    changed = [name for name in sorted(before.keys() | after.keys()) if before.get(name) != after.get(name)]
    return [
        *(f"{name}: {before.get(name, 'not there')} -> {after.get(name, 'gone')}" for name in changed),
        f"{len(changed)} of {len(after)} packages changed",
    ]


if __name__ == "__main__":
    print(*report(*(versions(Path(folder)) for folder in sys.argv[1:])), sep="\n")
