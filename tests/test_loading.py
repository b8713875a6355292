"""Users' code by name: which file a name stands for."""

from __future__ import annotations

from pathlib import Path

import pytest

from soter.errors import ConfigError
from soter.loading import load_named
from soter.missions import Mission


@pytest.mark.parametrize(
    "names", [("zone-a.py", "zone_a.py"), ("zone a.py", "zone.a.py"), ("zön.py", "zän.py"), ("区.py", "域.py")]
)
def test_files_whose_names_differ_in_any_character_are_different_modules(
    tmp_path: Path, names: tuple[str, str]
) -> None:
    for name in names:
        (tmp_path / name).write_text(f"FILE = {name!r}\n", encoding="utf-8")
    assert tuple(load_named(f"{tmp_path / name}:FILE", ConfigError) for name in names) == names


def test_a_file_is_loaded_once(tmp_path: Path) -> None:
    (tmp_path / "once.py").write_text("class Once:\n    pass\n")
    first, second = (load_named(f"{tmp_path}/once.py:Once", ConfigError) for _ in range(2))
    assert first is second


@pytest.mark.parametrize(
    ("count", "words"),
    [(0, "has no subclass of soter.Mission"), (2, "has 2 subclasses of soter.Mission: A0, A1; ")],
)
def test_classes_of_a_file_are_counted_in_words(tmp_path: Path, count: int, words: str) -> None:
    (tmp_path / "many.py").write_text(
        "from soter import Mission\n" + "".join(f"class A{n}(Mission): ...\n" for n in range(count))
    )
    with pytest.raises(ConfigError) as refusal:
        load_named(str(tmp_path / "many.py"), ConfigError, Mission)
    assert words in str(refusal.value)
