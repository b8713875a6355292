"""`soter report`: what it writes, what it refuses, how it exits."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageSequence
from typer.testing import CliRunner, Result

from soter.cli import app
from soter.report import film, mp4
from tests.record.helpers import recorded
from tests.report.unpacked import of_page


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("reports") / "made.mcap"
    recorded(path, duration_s=30.0, seed=4)
    return path


@pytest.fixture
def path(made: Path, tmp_path: Path) -> Path:
    """A recording in a folder of its own."""
    path = tmp_path / "run.mcap"
    path.write_bytes(made.read_bytes())
    return path


def ran(*arguments: str | Path) -> Result:
    """`soter report` in this process."""
    return CliRunner().invoke(app, ["report", *map(str, arguments)], env={"COLUMNS": "200"})


def test_the_page_goes_beside_the_recording(path: Path) -> None:
    done = ran(path)
    assert (done.exit_code, done.stderr) == (0, "")
    page = path.with_suffix(".html")
    assert f"page: {page} (" in done.stdout
    assert of_page(page.read_text()).document["summary"]["file"] == "run.mcap"


def test_the_page_goes_where_it_is_asked_for(path: Path, tmp_path: Path) -> None:
    assert ran(path, "-o", tmp_path / "other.html").exit_code == 0
    assert sorted(each.name for each in tmp_path.iterdir()) == ["other.html", "run.mcap"]


def test_pictures_alone_need_no_page(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(film, "GIF_FPS", 2)
    monkeypatch.setattr(mp4, "FPS", 2)
    done = ran(
        path, "--png", tmp_path / "run.png", "--gif", tmp_path / "run.gif", "--mp4", tmp_path / "run.mp4", "--film", "1"
    )
    assert done.exit_code == 0
    assert not path.with_suffix(".html").exists()
    with Image.open(tmp_path / "run.png") as picture:
        assert picture.size == (1600, 1200)
    with Image.open(tmp_path / "run.gif") as moving:
        assert len(list(ImageSequence.Iterator(moving))) == 2 + 1
    assert b"ftyp" in (tmp_path / "run.mp4").read_bytes()[:16]


@pytest.mark.pybullet
def test_a_still_shows_the_robots_where_they_were(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("soter.cli.still.SIZE_PX", (400, 300))
    stills = []
    for name, moment in (("begin", ("--at", "0")), ("end", ())):
        assert ran(path, "--still", tmp_path / f"{name}.png", *moment).exit_code == 0
        with Image.open(tmp_path / f"{name}.png") as drawn:
            assert drawn.size == (400, 300)
            stills.append(np.asarray(drawn).astype(int))
    moved = (abs(stills[0] - stills[1]).max(axis=2) > 40).mean()
    assert 0.0003 < moved < 0.05
    # The first robot's blue is on both.
    blue = np.array([0x1F, 0x6F, 0xB2]) / 0xB2
    for still in stills:
        assert (abs(still / still.max(axis=2, keepdims=True).clip(1) - blue).max(axis=2) < 0.12).sum() > 5


def test_what_a_film_needs_is_said(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    monkeypatch.delitem(sys.modules, "soter.report.mp4", raising=False)
    done = ran(path, "--mp4", tmp_path / "run.mp4")
    assert done.exit_code == 2
    assert "--mp4" in done.stderr
    assert "[film]" in done.stderr
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--at", "3"), "--still, which is not given"),
        pytest.param(("--still", "x.png", "--at", "31"), "allowed: 0 to 29.95", marks=pytest.mark.pybullet),
    ],
)
def test_a_moment_that_is_not_there_is_refused(path: Path, words: tuple[str, ...], message: str) -> None:
    done = ran(path, *(path.with_name(word) if word.endswith("png") else word for word in words))
    assert done.exit_code == 2
    assert message in done.stderr


def test_a_recording_that_was_cut_off_is_shown_as_far_as_it_goes(path: Path, tmp_path: Path) -> None:
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    done = ran(path, "-o", tmp_path / "cut.html", "--png", tmp_path / "cut.png")
    assert done.exit_code == 0
    assert "was cut off" in done.stdout
    assert of_page((tmp_path / "cut.html").read_text()).document["summary"]["truncated"]


@pytest.mark.parametrize(
    ("content", "message"),
    [(None, "cannot be read"), (b"no recording", "no MCAP file"), (b"", "does not begin as a recording")],
)
def test_what_is_no_recording_is_refused(tmp_path: Path, content: bytes | None, message: str) -> None:
    path = tmp_path / "run.mcap"
    if content is not None:
        path.write_bytes(content)
    done = ran(path)
    assert done.exit_code == 2
    assert message in done.stderr
    assert not path.with_suffix(".html").exists()


def test_the_recording_is_not_overwritten(path: Path) -> None:
    before = path.read_bytes()
    done = ran(path, "-o", path)
    assert done.exit_code == 2
    assert "--output" in done.stderr
    assert "would be overwritten: the command reads it" in done.stderr
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    ("option", "name", "message"),
    [
        ("--png", "run.jpg", "does not end in .png"),
        ("--gif", "run.png", "does not end in .gif"),
        ("--mp4", "run.gif", "does not end in .mp4"),
        ("--output", "nowhere/run.html", "there is no folder"),
        ("--output", ".", "it is a folder"),
    ],
)
def test_files_that_cannot_be_written_are_refused(
    path: Path, tmp_path: Path, option: str, name: str, message: str
) -> None:
    done = ran(path, option, tmp_path / name)
    assert done.exit_code == 2
    assert option in done.stderr
    assert message in done.stderr
