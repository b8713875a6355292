"""What the tests of the project itself need to know about its files."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = {"soter": ROOT / "soter", "soter_sim": ROOT / "sim" / "soter_sim"}


def python_files(*folders: Path) -> Iterator[Path]:
    """All Python files below the folders, in a fixed order."""
    for folder in folders:
        yield from sorted(folder.rglob("*.py"))


def module_name(path: Path) -> str:
    """The dotted name under which a file of one of the two packages is imported."""
    for package, folder in PACKAGES.items():
        if path.is_relative_to(folder):
            parts = path.relative_to(folder).with_suffix("").parts
            return ".".join((package, *(part for part in parts if part != "__init__")))
    raise ValueError(f"{path} belongs to neither package")
