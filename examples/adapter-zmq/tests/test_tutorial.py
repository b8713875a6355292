"""What docs/writing-an-adapter.md quotes is what the code says."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parents[1]
ROOT = HERE.parents[1]
PAGE = ROOT / "docs" / "writing-an-adapter.md"
FOLDERS = (HERE / "soter_zmq", ROOT / "soter" / "sdk", ROOT / "soter" / "onboard", ROOT / "sim" / "soter_sim")
EXCERPTS = re.findall(r"^```python no-run\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def lines_of(text: str) -> list[str]:
    """The lines that hold something, without indentation and comments at their end."""
    lines = (re.sub(r"\s+# (type: ignore|noqa).*", "", line).strip() for line in text.splitlines())
    return [line for line in lines if line]


@pytest.mark.parametrize("excerpt", EXCERPTS, ids=range(len(EXCERPTS)))
def test_an_excerpt_is_found_in_the_code_in_its_order(excerpt: str) -> None:
    """Lines may be left out of a quotation, such as docstrings; none may be added or changed."""
    for module in [path for folder in FOLDERS for path in folder.glob("*.py")]:
        source = iter(lines_of(module.read_text(encoding="utf-8")))
        if all(line in source for line in lines_of(excerpt)):
            return
    pytest.fail(f"no module has these lines in this order:\n{excerpt}")


def test_there_are_excerpts() -> None:
    assert len(EXCERPTS) >= 8
