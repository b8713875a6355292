"""Files that are written at the end of a run."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from soter.cli.app import app
from soter.cli.outputs import Output, Outputs, refuse_clashes
from soter.errors import ConfigError
from soter.hints import install_command
from soter.record.digest import MAGIC
from tests.project.source import ROOT


def test_nothing_is_there_before_it_is_written(tmp_path: Path) -> None:
    output = Output(tmp_path / "out.json", "--json")
    assert list(tmp_path.iterdir()) == []
    output.write(b"{}")
    assert [path.name for path in tmp_path.iterdir()] == ["out.json"]
    assert (tmp_path / "out.json").read_bytes() == b"{}"


def test_a_file_is_replaced_as_a_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "out.json"
    file.write_text("before")
    output = Output(file, "--json")

    def fails(self: Path, target: Path) -> Path:
        raise OSError("disk full")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", fails)
        with pytest.raises(OSError, match="disk full"):
            output.write(b"after")
    assert file.read_text() == "before"
    assert list(tmp_path.iterdir()) == [file]
    output.write(b"after")
    assert file.read_text() == "after"


def test_a_link_stays_one(tmp_path: Path) -> None:
    (tmp_path / "real.json").write_text("before")
    (tmp_path / "link.json").symlink_to("real.json")
    Output(tmp_path / "link.json", "--json").write(b"after")
    assert (tmp_path / "link.json").is_symlink()
    assert (tmp_path / "real.json").read_text() == "after"


def test_a_device_stays_one() -> None:
    before = Path("/dev/null").stat().st_ino
    Output(Path("/dev/null"), "--json").write(b"{}")
    assert Path("/dev/null").stat().st_ino == before


def test_a_folder_is_no_file(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"command line: --json: .* cannot be written: it is a folder"):
        Output(tmp_path, "--json")


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"there is no folder '.*/absent'; make it first"):
        Output(tmp_path / "absent" / "out.json", "--json")


def test_a_folder_that_takes_no_file_is_found_out_before() -> None:
    with pytest.raises(ConfigError, match="cannot be written"):
        Output(Path("/proc/out.json"), "--json")


def test_a_file_that_may_not_be_written_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "out.json"
    file.touch()
    # Whoever runs this as root may write everything.
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    with pytest.raises(ConfigError, match="it may not be written"):
        Output(file, "--json")


def test_a_name_that_is_too_long_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="too long"):
        Output(tmp_path / ("x" * 300), "--json")


def test_names_that_no_system_takes_are_refused_before_anything_runs(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"--json: '.*' cannot be written: File name too long"):
        refuse_clashes({"--json": tmp_path / ("x" * 300)})
    with pytest.raises(ConfigError, match="--json: '/' cannot be written: it is a folder"):
        Output(Path("/"), "--json")
    with pytest.raises(ConfigError, match="-o: '-' cannot be written: it does not go to standard output"):
        Output(Path("-"), "-o")


def test_one_file_is_not_written_twice(tmp_path: Path) -> None:
    refuse_clashes({"--json": tmp_path / "a", "--record": tmp_path / "b", "--picture": None})
    (tmp_path / "link").symlink_to("a")
    with pytest.raises(ConfigError, match=r"--record: '.*link' would be overwritten: --json names it too"):
        refuse_clashes({"--json": tmp_path / "a", "--record": tmp_path / "link"})


def test_what_a_command_reads_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"--json: '.*mission.toml' would be overwritten: the command reads it"):
        refuse_clashes({"--json": tmp_path / "absent" / ".." / "mission.toml"}, [tmp_path / "mission.toml"])


def test_a_device_may_be_written_twice() -> None:
    refuse_clashes({"--json": Path("/dev/null"), "--record": Path("/dev/null")})


def test_a_dash_is_standard_output(capsys: pytest.CaptureFixture[str]) -> None:
    outputs = Outputs({"--json": Path("-")})
    assert outputs.to_stdout
    outputs.write("--json", lambda: b"{}\n")
    assert capsys.readouterr().out == "{}\n"


def test_pictures_are_png(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"--picture: .* does not end in \.png"):
        Outputs({"--picture": tmp_path / "run.jpg"})


def test_without_matplotlib_the_hint_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    for drawing in ("soter.report.picture", "soter.report.ground"):
        monkeypatch.delitem(sys.modules, drawing, raising=False)
    with pytest.raises(ConfigError, match=re.escape(f"install it with: {install_command('report')}")):
        Outputs({"--picture": tmp_path / "run.png"})


# --- what is there already -----------------------------------------------------------------------------------

RUN = ("run", str(ROOT / "examples" / "surveillance.toml"), "--backend", "kinematic", "--planner", "straight-line",
       "--duration", "1", "--quiet")  # fmt: skip


@pytest.mark.parametrize(
    ("option", "name"), [("--json", "run.json"), ("--picture", "run.png"), ("--record", "run.mcap")]
)
def test_nothing_is_replaced_unasked(tmp_path: Path, option: str, name: str) -> None:
    file = tmp_path / name
    file.write_bytes(b"mine" if option != "--record" else MAGIC + b"mine")
    before = file.read_bytes()
    record = () if option == "--record" else ("--no-record",)
    done = CliRunner().invoke(app, [*RUN, *record, option, str(file)])
    assert done.exit_code == 2
    assert f"'{file}' is there already; name another file, or give --force to replace it" in done.output
    assert file.read_bytes() == before
    assert CliRunner().invoke(app, [*RUN, *record, option, str(file), "--force"]).exit_code == 0
    assert file.read_bytes() != before
    assert [*tmp_path.iterdir()] == [file], "nothing is left beside it"


def test_what_is_no_recording_is_never_replaced_by_one(tmp_path: Path) -> None:
    notes = tmp_path / "notes.md"
    notes.write_text("# Notes")
    done = CliRunner().invoke(app, [*RUN, "--record", str(notes), "--force"])
    assert done.exit_code == 2
    assert "is no recording; it is not replaced by one, nor with --force" in done.output
    assert notes.read_text() == "# Notes"


def test_what_has_come_during_a_run_is_kept(tmp_path: Path) -> None:
    output = Output(tmp_path / "result.json", "--json")
    output.path.write_text("mine")
    with pytest.raises(FileExistsError):
        output.write(b"new")
    assert output.path.read_text() == "mine"
    assert [*tmp_path.iterdir()] == [output.path]
