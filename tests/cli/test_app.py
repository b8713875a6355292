"""`soter` itself: help, version, what is no command."""

from __future__ import annotations

import re
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.core import TyperGroup
from typer.testing import CliRunner

import soter
from soter.cli import app, main
from soter.cli.exits import ExitCode, guard
from soter.cli.help import fit, only, tidy
from tests.project.source import ROOT

# Typer itself may load pydantic.
LIBRARIES = {"pybullet", "ompl", "matplotlib", "numpy", "scipy", "defusedxml"}


def said(*arguments: str) -> tuple[int, str]:
    """Exit code and output of a command, on a wide terminal so that nothing is broken into lines."""
    result = CliRunner().invoke(app, arguments, env={"COLUMNS": "200", "TERMINAL_WIDTH": "200"})
    return result.exit_code, result.output


def test_help_names_the_commands_and_an_example() -> None:
    code, text = said("--help")
    assert code == 0
    for expected in ("run", "backends", "--version", "soter run examples/surveillance.toml"):
        assert expected in text


def test_help_of_run_names_every_option_the_examples_and_the_exit_codes() -> None:
    code, text = said("run", "--help")
    assert code == 0
    options = (
        "--backend --engine --duration --seed --targets --robots --planner --no-rta --modules --json --picture --set "
        "--record --no-record --quiet"
    )
    for expected in (*options.split(), "MISSION", "grid|uniform|hostile", "Exit codes:", "130  interrupted"):
        assert expected in text


def test_examples_in_the_help_name_files_that_exist() -> None:
    _, text = said("run", "--help")
    named = {word for word in text.split() if word.startswith("examples/")}
    assert named
    assert [name for name in named if not (ROOT / name).is_file()] == []


@pytest.mark.parametrize("option", ["--set", "--compare"])
def test_examples_of_run_that_change_a_mission_are_accepted(option: str) -> None:
    _, text = said("run", "--help")
    [example] = [
        line.split()[2:] for line in text.splitlines() if line.startswith("   soter run examples") and option in line
    ]
    quick = ["--backend", "kinematic", "--planner", "straight-line", "--duration", "1", "--no-record"]
    assert said("run", *(str(ROOT / word) if "/" in word else word for word in example), *quick)[0] == ExitCode.OK


@pytest.mark.parametrize("command", [[], ["run"], ["compare"], ["sim", "zenoh"], ["campaign", "draw"]])
def test_help_names_no_type_for_arguments_and_for_options_that_take_no_value(
    command: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["soter", *command, "--help"])
    with pytest.raises(SystemExit):
        main()
    text = capsys.readouterr().out
    assert "--help" in text
    assert re.findall(r"bool|<\w+>|list\[|\[\[", text) == []


@pytest.mark.parametrize("columns", [60, 80])
def test_help_breaks_paragraphs_where_the_terminal_ends(columns: int) -> None:
    command = typer.main.get_command(app)
    tidy(command, columns)

    def paragraphs(of: Any) -> list[str]:
        below = [each for sub in getattr(of, "commands", {}).values() for each in paragraphs(sub)]
        return [*(of.help or "").split("\n\n"), *below]

    assert [each for each in paragraphs(command) if "\n" in each] == []


@pytest.mark.parametrize("command", [[], ["run"], ["campaign"], ["campaign", "draw"]])
def test_help_has_a_short_name_too(
    command: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["soter", *command, "-h"])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 0
    assert "Usage: soter" in capsys.readouterr().out


def test_ctrl_c_while_the_commands_are_read_leaves_no_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(typer.main, "get_command", interrupted)
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 130


def test_what_others_call_complete_is_no_question_of_a_shell(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Answers are held back until they are whole: a command that runs for long would say nothing."""
    monkeypatch.setattr("sys.argv", ["soter", "--version"])
    monkeypatch.setenv("_ROS_WHEELS_BOOTSTRAP_COMPLETE", "1")
    monkeypatch.setattr(sys.modules["soter.cli.app"], "answer", None)
    with pytest.raises(SystemExit):
        main()
    assert capsys.readouterr().out.startswith("soter ")


@pytest.mark.parametrize(
    ("typed", "completed"),
    [("soter rep", {"report", "replay"}), ("soter run --ba", {"--backend"}), ("soter campaign dr", {"draw"})],
)
def test_the_shell_completes_commands_and_options(
    typed: str, completed: set[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["soter"])
    monkeypatch.setenv("_SOTER_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", typed)
    monkeypatch.setenv("COMP_CWORD", str(typed.count(" ")))
    with pytest.raises(SystemExit):
        main()
    assert {*capsys.readouterr().out.split()} == completed


@pytest.mark.parametrize(
    ("typed", "completed"),
    [
        (["run", "--backend", "mav"], {"mavlink", "mavsdk"}),
        (["run", "--engine", ""], {"pybullet", "kinematic"}),
        (["run", "--targets", "h"], {"hostile"}),
        (["run", "--planner", "ompl-rrt"], {"ompl-rrtstar", "ompl-rrtconnect"}),
        (["run", "--modules", "geofence,b"], {"geofence,battery"}),
        (["run", "--mission", ""], {"surveillance", "patrol.py", "more/"}),
        (["run", "--ac", "mi"], {"mission"}),
        (["run", "--ac", "adversary:p"], {"adversary:pincer"}),
        # As bash asks, for which a colon and an equals sign end a word.
        (["run", "--ac", "adversary", ":", "p"], {"pincer"}),
        (["run", "--ac", "=", "adversary", ":", "p"], {"pincer"}),
        (["run", "--ac", "=", "m"], {"mission"}),
        (["check", ""], {"room.toml", "more/"}),
        # A folder that is alone would be taken for the end of the word.
        (["check", "m"], {"more/one.toml", "more/two.toml"}),
        (["check", "more/t"], {"more/two.toml"}),
        (["check", "nowhere/"], set()),
        (["conform", "r"], {"ros2", "room.toml"}),
        (["info", "run"], {"run.mcap"}),
    ],
    # Processes that share the tests among them have to call them alike: a set has another order in each.
    ids=lambda each: " ".join(sorted(each) if isinstance(each, set) else each),
)
def test_the_shell_completes_values(
    typed: list[str], completed: set[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    (tmp_path / "more").mkdir()
    for name in ("room.toml", "patrol.py", "run.mcap", ".hidden.toml", "more/one.toml", "more/two.toml"):
        (tmp_path / name).touch()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["soter"])
    monkeypatch.setenv("_SOTER_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", "\n".join(["soter", *typed]))
    monkeypatch.setenv("COMP_CWORD", str(len(typed)))
    with pytest.raises(SystemExit):
        main()
    assert {*capsys.readouterr().out.split()} == completed


@pytest.mark.parametrize("width", [60, 80, 100])
def test_examples_and_exit_codes_are_broken_where_a_reader_would(width: int) -> None:
    whole = "  soter run a.toml --backend kinematic --ac adversary:chase --set rta.geofence.delta_s=0.25 -o p/page.html"
    text = fit(f"Examples:\n\n{whole}\n\n  1  {'word ' * 40}\n     and more", width)
    lines = text.splitlines()
    assert max(map(len, lines)) <= width
    pasted = text.split("\n\n")[1].replace(" \\\n", " ")
    assert pasted.split() == whole.split()
    assert all(line.split()[0].startswith("-") for line in text.split("\n\n")[1].splitlines()[1:])
    assert all(line.startswith("     ") for line in text.split("\n\n")[2].splitlines()[1:])


@pytest.mark.parametrize("command", [["info"], ["sim", "zenoh"], ["campaign", "draw"]])
def test_a_command_that_is_named_has_its_options_and_the_others_their_names(command: list[str]) -> None:
    part = typer.main.get_command(only(app, ["soter", *command]))
    assert isinstance(part, TyperGroup)
    whole = typer.main.get_command(app)
    assert isinstance(whole, TyperGroup)
    assert {*part.commands} == {*whole.commands}
    one: Any = part
    other: Any = whole
    for name in command:
        one, other = one.commands[name], other.commands[name]
    assert [each.name for each in one.params] == [each.name for each in other.params] != []
    assert part.commands["run"].params == []
    assert part.commands["run"].help == whole.commands["run"].help


def test_version() -> None:
    assert said("--version") == (0, f"soter {soter.__version__}\n")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("run", "examples/surveillance.toml", "--sed", "2"), "No such option: --sed"),
        (("tune",), "Missing argument 'MISSION'"),
        (("fly",), "No such command 'fly'"),
        (("run", "m.toml", "--duration", "long"), "Invalid value for '--duration'"),
        (("run", "m.toml", "--robots", "2.5"), "Invalid value for '--robots'"),
        (("backends", "pybullet"), "unexpected extra argument"),
    ],
)
def test_what_the_parser_refuses_exits_with_2(arguments: tuple[str, ...], message: str) -> None:
    code, text = said(*arguments)
    assert code == 2
    assert message in text


def test_without_a_command_it_shows_the_help() -> None:
    _, text = said()
    assert "Usage" in text
    assert "backends" in text


def test_help_is_quick_since_it_loads_no_library() -> None:
    program = (
        "import sys\n"
        "from soter.cli import app\n"
        "try:\n"
        "    app(['run', '--help'])\n"
        "except SystemExit:\n"
        "    pass\n"
        "print('loaded', *sorted({name.partition('.')[0] for name in sys.modules}))\n"
    )
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", program], cwd=ROOT, capture_output=True, text=True, check=True
    )
    loaded = done.stdout.rsplit("loaded", 1)[1].split()
    assert "typer" in loaded
    assert not LIBRARIES & set(loaded)


def test_python_m_soter_cli_is_soter() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "soter.cli", "--version"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stdout == f"soter {soter.__version__}\n"


def test_threads_that_foreign_code_has_left_do_not_keep_the_program(monkeypatch: pytest.MonkeyPatch) -> None:
    ended, codes = threading.Event(), []

    def command(**_: object) -> None:
        threading.Thread(target=ended.wait).start()
        raise SystemExit(3)

    def ends(code: int) -> None:
        codes.append(code)
        ended.set()

    monkeypatch.setattr("typer.main.get_command", lambda _: command)
    # The name of the module is that of what is in it.
    monkeypatch.setattr(sys.modules["soter.cli.app"], "tidy", lambda _: None)
    monkeypatch.setattr(sys.modules["soter.cli.app"], "_ENDS_S", 0.0)
    monkeypatch.setattr("os._exit", ends)
    with pytest.raises(SystemExit):
        main()
    assert ended.wait(10.0)
    assert codes == [3]


def test_a_library_of_an_extra_that_is_missing_is_no_fault_of_soter(capsys: pytest.CaptureFixture[str]) -> None:
    for name, complaint in (("scipy.ndimage", 'pip install -e "'), ("antigravity", "this is a fault of SOTER")):
        code = ExitCode.BAD_INPUT if name != "antigravity" else ExitCode.RUN_FAILED
        with pytest.raises(typer.Exit) as ended, guard():
            raise ModuleNotFoundError(f"No module named '{name}'", name=name)
        assert ended.value.exit_code == code
        said = capsys.readouterr().err
        assert complaint in said
        assert ("Traceback" in said) == (code == ExitCode.RUN_FAILED)
