"""`soter new adapter`: what it writes runs, passes its own tests, and is found by its name."""

from __future__ import annotations

import os
import subprocess
import sys
from errno import ENOSPC
from pathlib import Path

import pytest

from soter.cli.new import adapter, check_name, write_adapter
from soter.errors import ConfigError
from soter.onboard.command import Command, GoalMessage, Report
from soter.onboard.wire import GateReport
from tests.project.source import ROOT
from tests.warm import warm


def found_in(path: Path) -> dict[str, str]:
    """An environment in which a package is found in a folder, as it would be once it is installed."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, (path, ROOT, ROOT / "sim"))), "COLUMNS": "200"}


def soter(*arguments: str, path: Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    return warm("soter", *arguments, cwd=cwd, env=found_in(path))


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A package that was just written; its metadata is what `pip install -e` leaves behind."""
    folder = tmp_path_factory.mktemp("new") / "soter-sand_crawler"
    done = soter("new", "adapter", "sand_crawler", path=ROOT, cwd=folder.parent)
    assert done.returncode == 0, done.stderr
    assert "pip install -e soter-sand_crawler" in done.stdout
    metadata = folder / "soter_sand_crawler-0.1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: soter-sand_crawler\nVersion: 0.1.0\n")
    target = "sand_crawler = soter_sand_crawler.adapter:SandCrawlerBackend"
    assert target.replace("= soter", '= "soter') in (folder / "pyproject.toml").read_text()
    (metadata / "entry_points.txt").write_text(f"[soter.adapters]\n{target}\n")
    return folder


@pytest.mark.long
def test_its_own_tests_pass(package: Path) -> None:
    words = (sys.executable, "-m", "pytest", "-q", "-W", "error", "-p", "no:cacheprovider")
    done = subprocess.run(words, cwd=package, env=found_in(package), capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


def test_it_is_listed_and_judged_by_its_name(package: Path) -> None:
    listed = soter("backends", path=package, cwd=package.parent)
    assert "sand_crawler" in listed.stdout
    clauses = ("--only", "lifecycle.init", "--only", "link.stops")
    judged = soter("conform", "sand_crawler", *clauses, path=package, cwd=package.parent)
    assert judged.returncode == 0, judged.stdout + judged.stderr


def test_it_is_clean_and_says_nothing_of_what_it_was_made_from(package: Path) -> None:
    made_since = ("dist-info", "__pycache__")
    files = [
        path for path in package.rglob("*") if path.is_file() and not any(each in str(path) for each in made_since)
    ]
    assert {path.name for path in files} >= {"README.md", "pyproject.toml", "tests.yml", "adapter.py", "harness.py"}
    assert not [path for path in files if path.suffix == ".in" or "template" in path.read_text().lower()]
    for path in (path for path in files if path.suffix == ".py"):
        compile(path.read_text(), path, "exec")
        assert max(map(len, path.read_text().splitlines())) <= 120


def test_its_page_names_all_that_a_wire_of_ones_own_has_to_carry(package: Path) -> None:
    page = (package / "README.md").read_text()
    for message in (Command, GoalMessage, Report, GateReport):
        assert f"{message.__name__}`" in page
        assert [field for field in message._fields if f"`{field}`" not in page] == []


@pytest.mark.parametrize("name", ["", "Crawler", "my-bot", "2bot", "a__b", "_a", "a_", "class", "a b", "../a", "zenoh"])
def test_a_name_that_will_not_do_is_refused(name: str) -> None:
    with pytest.raises(ConfigError, match=r"NAME is .*allowed"):
        check_name(name)


def test_nothing_that_is_there_is_overwritten(tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("mine")
    for taken in (tmp_path, tmp_path / "mine"):
        with pytest.raises(ConfigError, match=r"something at .* already; name a new folder with --out"):
            write_adapter("crawler", taken)
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


def test_an_empty_folder_is_filled(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    adapter("crawler", tmp_path)
    assert (tmp_path / "soter_crawler" / "adapter.py").is_file()
    assert f"pip install -e {tmp_path}" in capsys.readouterr().out


def test_on_a_full_disk_nothing_is_left_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = Path.write_text

    def full(self: Path, text: str, **more: str) -> int:
        whole(self, text[:10], **more)
        if self.name == "tests.yml":
            return len(text)
        raise OSError(ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(ConfigError, match=r"cannot be written: .*No space left"):
        write_adapter("crawler", tmp_path / "new")
    assert [*tmp_path.iterdir()] == []
    monkeypatch.undo()
    assert write_adapter("crawler", tmp_path / "new")
