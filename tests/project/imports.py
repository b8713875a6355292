"""Reads the imports of a Python file without running it."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from tests.project.source import PACKAGES, module_name


class Import(NamedTuple):
    """One import: the dotted name of the module that is loaded, and the line that loads it."""

    target: str
    line: int


def is_module(dotted: str) -> bool:
    """Whether a dotted name is a module or folder of one of the two packages."""
    package, *rest = dotted.split(".")
    if package not in PACKAGES:
        return False
    path = PACKAGES[package].joinpath(*rest)
    return path.is_dir() or path.with_suffix(".py").is_file()


def read(path: Path) -> Iterator[Import]:
    """Every import of a file: those in functions, under TYPE_CHECKING and by `import_module("...")` too.

    `from soter.sdk import values` is an import of `soter.sdk.values`, `from soter.sdk import Robot` one of
    `soter.sdk`.
    """
    here = module_name(path).split(".")
    package = here if path.name == "__init__.py" else here[:-1]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"), filename=str(path))):
        match node:
            case ast.Import(names=names):
                yield from (Import(alias.name, node.lineno) for alias in names)
            case ast.ImportFrom(module=module, names=names, level=level):
                base = package[: len(package) - level + 1] if level else []
                source = ".".join((*base, *([module] if module else [])))
                for alias in names:
                    member = f"{source}.{alias.name}"
                    yield Import(member if is_module(member) else source, node.lineno)
            case ast.Call(
                func=ast.Name(id="import_module" | "__import__") | ast.Attribute(attr="import_module"),
                args=[ast.Constant(value=str(target)), *_],
            ):
                yield Import(target, node.lineno)
