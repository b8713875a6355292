"""Finished runs, one JSON file each, so that the evaluation can be stopped and carried on."""

from __future__ import annotations

import hashlib
import json
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final

from soter.runner import RunResult
from tools.acceptance.cases import Case

ROOT: Final = Path(__file__).resolve().parents[2]
FOLDER: Final = ROOT / "out" / "accept"
_SOURCES: Final = (
    "soter", "sim", "examples", "tools/acceptance/planners.py", "tools/acceptance/alone.xml",
    "tools/acceptance/wide.xml",
)  # fmt: skip
_SUFFIXES: Final = {".py", ".toml", ".xml", ".urdf"}
_LIBRARIES: Final = ("soter-rta", "numpy", "scipy", "ompl", "pybullet")


def source_hash(root: Path = ROOT) -> str:
    """Return a hash over everything that a run's outcome can depend on: the code, the examples, the libraries."""
    digest = hashlib.sha256()
    for source in _SOURCES:
        place = root / source
        for path in [place] if place.is_file() else sorted(place.rglob("*")):
            if path.suffix in _SUFFIXES and path.is_file():
                digest.update(f"{path.relative_to(root)}\0".encode())
                digest.update(path.read_bytes())
    for library in _LIBRARIES:
        digest.update(f"{library}=={_version(library)}\0".encode())
    return digest.hexdigest()[:16]


def _version(library: str) -> str:
    try:
        return version(library)
    except PackageNotFoundError:
        return "missing"


class Store:
    """The finished runs of one state of the sources.

    Args:
        source: from `source_hash`.
        scale: what durations are multiplied by.
        folder: where the files are.
    """

    def __init__(self, source: str, scale: float = 1.0, folder: Path = FOLDER) -> None:
        self.source: Final = source
        self.scale: Final = scale
        self.folder: Final = folder

    def path(self, case: Case) -> Path:
        """Return where a case's result is, or will be."""
        key = hashlib.sha256(f"{self.source}\0{case.command(self.scale)}\0{case.loaded}".encode()).hexdigest()[:12]
        return self.folder / f"{case.name}-{key}.json"

    def load(self, case: Case) -> RunResult | None:
        """Return the result of a finished run; None if there is none, or if its file is damaged."""
        try:
            return RunResult.model_validate(json.loads(self.path(case).read_text())["result"])
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def save(self, case: Case, result: RunResult) -> None:
        """Store the result of a finished run; a file is either whole or not there."""
        self.folder.mkdir(parents=True, exist_ok=True)
        path = self.path(case)
        content = {
            "case": case.name,
            "command": case.command(self.scale),
            "source": self.source,
            "loaded": case.loaded,
            "result": result.model_dump(mode="json"),
        }
        part = path.with_suffix(".part")
        part.write_text(json.dumps(content, indent=2) + "\n")
        part.replace(path)
