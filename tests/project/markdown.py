"""Finds the code blocks and links of a Markdown page."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

_FENCE = re.compile(r"^```(?P<info>[^`\n]*)\n(?P<code>.*?)^```$", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"\]\((?P<target>[^)\s]+)\)")


class Block(NamedTuple):
    """A fenced code block: its language, the words after it, its text and the page's line where it starts."""

    language: str
    marks: frozenset[str]
    code: str
    line: int


def blocks(page: Path) -> Iterator[Block]:
    """All fenced code blocks of a page, in order."""
    text = page.read_text(encoding="utf-8")
    for fence in _FENCE.finditer(text):
        language, *marks = fence["info"].split() or [""]
        yield Block(language, frozenset(marks), fence["code"], text.count("\n", 0, fence.start()) + 1)


def title_of(block: Block) -> str | None:
    """The file that a block is to be saved as."""
    named = [mark for mark in block.marks if mark.startswith("title=")]
    return named[0].removeprefix("title=").strip('"') if named else None


def exit_code(block: Block) -> int:
    """What the last command of a block has to exit with."""
    return next((int(mark.removeprefix("exit-")) for mark in block.marks if mark.startswith("exit-")), 0)


def commands_of(block: Block) -> Iterator[tuple[int, str]]:
    """The commands of a shell block, each whole, with their lines on the page; without what a console has printed."""
    shown = any(line.startswith("$ ") for line in block.code.splitlines())
    for found in re.finditer(r"(?:\\\n|[^\n])+", block.code):
        text = found[0].replace("\\\n", " ")
        if text.startswith("$ ") if shown else shlex.split(text, comments=True):
            yield block.line + 1 + block.code.count("\n", 0, found.start()), text.removeprefix("$ ")


def links(page: Path) -> Iterator[str]:
    """The targets of all links and pictures of a page that lead to another file."""
    for link in _LINK.finditer(prose(page)):
        if not re.match(r"[a-z]+:|#", link["target"]):
            yield link["target"].partition("#")[0]


def prose(page: Path) -> str:
    """The text of a page without its code blocks."""
    return _FENCE.sub("", page.read_text(encoding="utf-8"))
