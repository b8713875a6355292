"""What holds for the project's files as a whole: sizes, the facade, locks, nothing left undone."""

from __future__ import annotations

import re
import tokenize
from collections import Counter
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

import pytest

import soter
from tests.project.source import PACKAGES, ROOT, python_files

MOST_LINES = 400
MOST_PUBLIC_NAMES = 30
LOCKS = sorted((ROOT / "requirements").glob("*.txt"))
TEXT_SUFFIXES = {".md", ".py", ".pyi", ".sh", ".toml", ".txt", ".xml", ".yml"}
FOLDERS = (
    ".github",
    "soter",
    "sim",
    "tests",
    "examples",
    "benchmarks",
    "tools",
    "docs",
    "typings",
    "requirements",
    "ros",
)


def test_a_citation_names_this_version() -> None:
    named = re.search(r"^version: (.*)$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)
    assert named is not None
    assert named[1] == soter.__version__


def lines_of_code(path: Path) -> int:
    """The lines of a file that hold code: no blank lines, comments or docstrings."""
    lines: set[int] = set()
    skipped = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT}
    starts_statement = True
    with path.open("rb") as file:
        for token in tokenize.tokenize(file.readline):
            # A string that is a statement of its own documents what stands above it.
            documents = token.type == tokenize.STRING and starts_statement
            if token.type not in skipped | {tokenize.ENCODING, tokenize.ENDMARKER} and not documents:
                lines.update(range(token.start[0], token.end[0] + 1))
            if token.type not in {tokenize.COMMENT, tokenize.NL}:
                starts_statement = token.type in skipped | {tokenize.ENCODING}
    return len(lines)


def project_texts() -> list[Path]:
    """Every text that belongs to the project."""
    below = (path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*")))
    return [path for path in (*sorted(ROOT.glob("*.*")), *below) if path.suffix in TEXT_SUFFIXES]


def test_modules_are_small() -> None:
    sizes = {
        str(path.relative_to(ROOT)): lines_of_code(path)
        for path in python_files(ROOT / "soter", ROOT / "sim", ROOT / "tools")
    }
    assert {name: size for name, size in sizes.items() if size > MOST_LINES} == {}


def test_lines_of_code_leaves_out_comments_and_docstrings(tmp_path: Path) -> None:
    file = tmp_path / "file.py"
    file.write_text('"""Summary.\n\nMore.\n"""\n\n# Why.\nx = (\n    "a"\n    "b"\n)\n\n\ndef f():\n    """Doc."""\n')
    assert lines_of_code(file) == 5


def test_the_facade_is_narrow_and_whole() -> None:
    names = getattr(soter, "__all__", [])
    assert len(names) <= MOST_PUBLIC_NAMES
    assert len(set(names)) == len(names)
    for name in names:
        assert getattr(soter, name) is not None


@pytest.mark.parametrize("package", sorted(PACKAGES))
def test_packages_say_that_they_are_typed(package: str) -> None:
    assert (PACKAGES[package] / "py.typed").is_file()


@pytest.mark.parametrize("adapter", entry_points(group="soter.adapters"), ids=lambda each: each.name)
def test_registered_adapters_are_there_without_their_libraries(adapter: EntryPoint) -> None:
    assert isinstance(adapter.load(), type)


@pytest.mark.parametrize("lock", LOCKS, ids=lambda path: path.name)
def test_locks_name_versions_and_no_index(lock: Path) -> None:
    pinned = re.compile(r"[a-z0-9._-]+==[^ ;]+( ; [^#]+)?")
    text = lock.read_text()
    assert "://" not in text
    requirements = [line for line in text.splitlines() if not line.startswith("#")]
    assert requirements
    assert [line for line in requirements if not pinned.fullmatch(line)] == []


def test_locks_agree() -> None:

    def versions(lock: Path) -> set[str]:
        lines = (line.partition(" ;")[0] for line in lock.read_text().splitlines())
        return {line for line in lines if not line.startswith("#")}

    largest = versions(ROOT / "requirements" / "check.txt")
    names = {line.partition("==")[0] for line in largest}
    for lock in LOCKS:
        lines = versions(lock)
        if lock.stem == "ros2":
            # An environment of its own, with more in it; what both have is the same.
            lines = {line for line in lines if line.partition("==")[0] in names}
        if lock.stem != "pybullet":
            assert lines <= largest, f"{lock.name}: run `make lock`"


def test_nothing_is_left_undone() -> None:
    # The brackets keep this line from finding itself.
    marks = re.compile(r"\b(TO[D]O|FIX[M]E|XX[X])\b")
    found = [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()}"
        for path in project_texts()
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1)
        if marks.search(line)
    ]
    assert found == []


def test_no_two_classes_have_one_name() -> None:
    # A script's robot and controller are not an adapter's: the public interfaces promise both names.
    found = re.compile(r"^class (\w+)", re.MULTILINE)
    names = Counter(name for path in python_files(PACKAGES["soter"]) for name in found.findall(path.read_text()))
    assert {name for name, times in names.items() if times > 1} == {"Controller", "Robot"}


def test_every_file_that_opens_pages_is_one_that_the_browsers_tests_are_taken_from() -> None:
    named = re.compile(r"^from tests\.report\.chromium ", re.MULTILINE)
    opens = {path for path in (ROOT / "tests").glob("*/test_*.py") if named.search(path.read_text())}
    taken = set((ROOT / "tests").glob("*/test_*browser.py"))
    assert "tests/*/test_*browser.py" in (ROOT / "Makefile").read_text()
    assert opens
    assert opens - taken == {ROOT / "tests" / "benchmarks" / "test_benchmarks.py"}
