"""What `soter check` accepts `soter run` runs, and what it refuses is refused there too."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from soter.cli import app
from soter.missions import ROOM

MODULES = """
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from soter import Region, RTAModule
from soter.errors import IllFormedModule


@dataclass(frozen=True)
class West(Region):
    edge: object = 0.3
    least_m: float = 0.0

    def margin(self, situation):
        return 14.9 - situation.own.x_m - self.least_m

    def edge_margin(self, safer):
        return self.edge


def west(kit, edge=0.3, delta_s=0.05, **more):
    safe, safer = West(edge), West(edge, 0.3)
    sc = kit.retreat("back")
    return RTAModule(kit.name, kit.ac, sc, delta_s, safe, safer, kit.model, peers_within_m=0.0, **more)


def numpy_edge(kit):
    return west(kit, np.float32(0.3))


def numpy_numbers(kit):
    return west(kit, delta_s=np.float64(0.05), dwell_s=np.int64(1), keep=np.float32(0.0))


def fractions(kit):
    return west(kit, Fraction(3, 10), Fraction(1, 20))


def of_five(kit):
    if len(kit.workspace.robots) < 5:
        raise ValueError("a formation needs five robots")
    return west(kit)


def with_a_premise_of_another_name(kit):
    def premise(module, timing):
        raise IllFormedModule("west-rule", "P2a", "it needs a wider room")

    return west(kit, premise=premise)
"""

READY = """
from soter import Fence, Node, RTAModule, SpeedBound, Topic


class Home(Node):
    period_s = 0.05
    publishes = ("waypoint",)

    def __init__(self, name):
        self.name, self.out = name, Topic("waypoint")

    def step(self, situation):
        self.out.publish(None)


ac, sc, safe, safer = Home("ac"), Home("sc"), Fence(0, 15, 0, 15), Fence(0.5, 14, 0.5, 14)
west = RTAModule("west", ac, sc, 0.05, safe, safer, SpeedBound(0.22, 1.0), dwell_s=10**400)
"""

ROW = """<configuration>
  <dimension x="13" y="8" z="1"/>
  <robots>{robots}</robots>
  <charging_stations>{stations}</charging_stations>
</configuration>
"""


def both(tmp_path: Path, *settings: str, file: Path | str = ROOM, tried: bool = True) -> list[tuple[int, str]]:
    """Return exit code and output of `soter check` and of `soter run`, recorded, with these settings.

    `tried` False has modules run without trials.
    """
    words = [str(file), "--backend", "kinematic"]
    for each in settings if any("planner=" in each for each in settings) else ("planner=straight-line", *settings):
        words += ["--set", each]
    said = []
    recorded = ("--duration", "1", "--record", str(tmp_path / "run.mcap"), *([] if tried else ["--accept-unproved"]))
    for command, more in (("check", ("--budget", "2")), ("run", recorded)):
        done = CliRunner().invoke(app, [command, *words, *more])
        said.append((done.exit_code, done.output))
    return said


@pytest.fixture
def mission(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A mission file in the folder where commands run, with modules in a file beside it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "modules.py").write_text(MODULES)
    file = tmp_path / "mission.toml"
    file.write_text(f'workspace = "{ROOM.parent / "room.xml"}"\n')
    return file


def declared(name: str) -> str:
    return f"rta.module.west.declare=modules.py:{name}"


@pytest.mark.parametrize("numbers", ["numpy_edge", "numpy_numbers", "fractions"])
def test_numbers_of_other_classes_in_a_declaration_are_numbers(numbers: str, mission: Path, tmp_path: Path) -> None:
    said = both(tmp_path, declared(numbers), "robots=1", file=mission, tried=False)
    assert [code for code, _ in said] == [0, 0], said


def test_a_premise_that_says_another_name_is_a_finding_all_the_same(mission: Path, tmp_path: Path) -> None:
    (checked, findings), (ran, refusal) = both(tmp_path, declared("with_a_premise_of_another_name"), file=mission)
    assert (checked, ran) == (1, 2)
    assert "REJECTED" in findings
    assert "module 'west' is ill-formed (P2a): it needs a wider room" in refusal


def test_a_module_that_fewer_robots_cannot_have_is_a_gap_and_no_fault(mission: Path, tmp_path: Path) -> None:
    xs = [1.0 + 2.0 * number for number in range(5)]
    robots = "".join(f'<robot id="{i}"><start x="{x}" y="1.5" z="0"/></robot>' for i, x in enumerate(xs, start=1))
    stations = "".join(f'<box><low x="{x - 0.2}" y="1.3" z="0"/><high x="{x + 0.2}" y="1.7" z="0"/></box>' for x in xs)
    (tmp_path / "row.xml").write_text(ROW.format(robots=robots, stations=stations))
    mission.write_text('workspace = "row.xml"\ntargets = "uniform"\n')
    (checked, findings), (ran, refusal) = both(tmp_path, declared("of_five"), file=mission)
    assert (checked, ran) == (1, 2)
    for said in (findings, refusal):
        assert "not tested: with 4 of 5 robots" in said
        assert "fault of" not in said
    (_, (accepted, output)) = both(tmp_path, declared("of_five"), file=mission, tried=False)
    assert accepted == 0
    assert "P2a of module 'west' is ASSUMED: it was not tried" in " ".join(output.split())


PLANTED = "tests.check.planted"


@pytest.mark.parametrize(
    ("module", "text"),
    [
        ("right", ""),
        ("sc_speeds", r"P2a of module 'east' is REJECTED: one robot, .* left phi_safe by 0\.\d+ m"),
    ],
)
def test_a_module_that_trials_break_is_refused_as_it_is_rejected(
    module: str, text: str, mission: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing is proved of a user's module: what stands for it is tried before a robot is opened, as by `check`."""
    (tmp_path / "floor.toml").write_text(
        "[[station]]\nx_m = 3.0\ny_m = 3.0\nside_m = 0.4\n[fence]\npolygon = [[0, 0], [6, 0], [6, 6], [0, 6]]\n"
    )
    mission.write_text(
        'workspace = "floor.toml"\ntargets = "uniform"\nrta.modules = []\n'
        f'[rta.module.east]\ndeclare = "{PLANTED}:{module}"'
    )
    monkeypatch.setattr("soter.check.mission.BUDGET", 12)
    words = [str(mission), "--backend", "kinematic", "--set", "planner=straight-line"]
    checked = CliRunner().invoke(app, ["check", *words, "--budget", "12"])
    ran = CliRunner().invoke(app, ["run", *words, "--duration", "1", "--no-record"])
    assert (checked.exit_code, ran.exit_code) == ((1, 2) if text else (0, 0)), (checked.output, ran.output)
    assert re.search(text, " ".join(ran.output.split())), ran.output
    assert not text or "rta.module.east: " in ran.output
    assert "before it runs, east: trial 1 of at most 12; --accept-unproved does without" in " ".join(ran.output.split())


def test_a_number_of_a_ready_made_declaration_that_no_float_holds_is_refused(mission: Path, tmp_path: Path) -> None:
    (tmp_path / "ready.py").write_text(READY)
    for code, output in both(tmp_path, "rta.module.west.declare=ready.py:west", file=mission):
        assert code == 2, output
        assert "as dwell_s, allowed: a number that a float can hold" in output


@pytest.mark.parametrize("name", ["search", "fastest-to-boundary"])
def test_adversaries_do_without_a_fence(name: str, tmp_path: Path) -> None:
    ground = "[[station]]\nx_m = 1.0\ny_m = 1.0\nside_m = 0.5\n"
    for keep_out in ("", "[[keep_out]]\ncircle = { x_m = 3.0, y_m = 3.0, radius_m = 0.5 }\n"):
        (tmp_path / "open.toml").write_text(ground + keep_out)
        mission = tmp_path / "mission.toml"
        mission.write_text('workspace = "open.toml"\nrobots = 1\n')
        said = both(tmp_path, 'rta.modules=["obstacle","battery"]', f"ac=adversary:{name}", file=mission)
        assert [code for code, _ in said] == [0, 0], said
        (tmp_path / "run.mcap").unlink()


@pytest.mark.parametrize(
    "settings",
    [
        ("mission.use=waypoints", "mission.points=[[1,1]]", "mission.timeout_s=1e7"),
        ("mission={root}/delivery.py", "mission.jobs=[[[1e308,1],[1,1]]]"),
        ("mission={root}/coverage.py", "mission.margin_m=1e308"),
    ],
)
def test_options_that_no_robot_can_follow_are_refused(settings: tuple[str, ...], tmp_path: Path) -> None:
    root = Path(__file__).parents[2] / "examples" / "missions"
    (checked, finding), (ran, refusal) = both(tmp_path, *(each.format(root=root) for each in settings))
    assert (checked, ran) == (2, 2), (finding, refusal)
    assert finding.splitlines()[-1] == refusal.splitlines()[-1]


@pytest.mark.parametrize(("kind", "option"), [("wheel_slip", "left = 0.96"), ("kill", "start_s = 0.5")])
def test_faults_of_vehicles_that_cannot_be_impaired_are_refused_by_their_key(
    kind: str, option: str, mission: Path
) -> None:
    text = mission.read_text() + f'backend = "zenoh"\nplanner = "straight-line"\n[[fault]]\nkind = "{kind}"\n{option}\n'
    mission.write_text(text)
    for command in (("check", "--budget", "2"), ("run", "--no-record", "--duration", "1")):
        done = CliRunner().invoke(app, [command[0], str(mission), *command[1:]])
        assert done.exit_code == 2, done.output
        assert f"fault.0.kind: it is '{kind}', which needs a vehicle" in done.output


def test_a_planner_without_a_model_of_its_options_is_refused(mission: Path, tmp_path: Path) -> None:
    (tmp_path / "bare_planner.py").write_text(
        "from soter.stack.planners import Planner\n\n\nclass Bare(Planner):\n    options_model = None\n"
        "    def plan(self, request): ...\n"
    )
    said = both(tmp_path, "planner=bare_planner:Bare", file=mission)
    for code, output in said:
        assert code == 2, output
        assert "options_model" in output


BROKEN = """
from soter import Controller, Mission
from soter.stack.planners import Planner
from soter.stack.planners.base import PlannerOptions


class Script(Mission):
    def __init__(self, options):
        raise RuntimeError("no such map")

    async def run(self, robot):
        await robot.wait_s(1.0)


class Own(Controller):
    def __init__(self, options):
        raise RuntimeError("no such map")

    def step(self, robot): ...


class Crooked(Planner):
    options_model = PlannerOptions

    def __init__(self, *given):
        raise RuntimeError("no such map")

    def plan(self, request): ...
"""

NOBODY = """backend = "zenoh"
[backends.zenoh]
session = { mode = "client", connect = ["tcp/127.0.0.1:9"] }
robots.1.namespace = "robot1"
robots.2.namespace = "robot2"
"""
"""A backend that cannot be opened."""


@pytest.mark.parametrize("wire", [False, True])
@pytest.mark.parametrize(
    ("setting", "said"),
    [
        (
            "mission=broken_acs.py:Script",
            r"mission: '.*/broken_acs.py:Script' failed: RuntimeError: no such map \(broken_acs.py, line 9\)",
        ),
        (
            "ac=broken_acs.py:Own",
            r"ac: it is '.*:Own', which cannot be made: RuntimeError: no such map \(broken_acs.py, line 17\)",
        ),
        (
            "planner=broken_acs:Crooked",
            "planner: it is 'broken_acs:Crooked', which cannot be made: RuntimeError: no such map",
        ),
        ("ac=broken_acs.py:None", "ac: it is '.*/broken_acs.py:None', but there is no 'None' in it"),
        ("mission.speed=3", "mission.speed: unknown key"),
        ("planners.ompl-bitstar.range_m=-1", "planners.ompl-bitstar.range_m: "),
    ],
)
def test_acs_that_cannot_be_made_are_refused_before_a_robot_is_opened(
    wire: bool, setting: str, said: str, mission: Path, tmp_path: Path
) -> None:
    (tmp_path / "broken_acs.py").write_text(BROKEN)
    mission.write_text(mission.read_text() + (NOBODY if wire else 'backend = "kinematic"\n'))
    for command in (("check", "--budget", "2"), ("run", "--no-record", "--duration", "1")):
        done = CliRunner().invoke(app, [command[0], str(mission), "--set", setting, *command[1:]])
        assert done.exit_code == 2, done.output
        assert re.search(said, done.output), done.output


SPLIT = """
[distribution.processes.alpha]
robots = [1]
[distribution.processes.beta]
robots = [2]
planner = true
"""


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        (["distribution.via=zeno"], "distribution.via: unknown bus 'zeno', did you mean 'zenoh'"),
        (["distribution.bus.conect=3"], "distribution.bus.conect: unknown key, did you mean 'connect'?"),
        (["ac=fleets.py:Together"], "fleets.py:Together', which drives all robots together"),
    ],
)
def test_what_no_process_of_a_mission_could_begin_with_is_refused(
    settings: list[str], said: str, mission: Path, tmp_path: Path
) -> None:
    (tmp_path / "fleets.py").write_text(
        "from soter import Controller\n\n\nclass Together(Controller):\n    fleet = True\n\n"
        "    def act(self, now_s, tick): ...\n"
    )
    mission.write_text(mission.read_text() + NOBODY + SPLIT)
    words = [str(mission), *(word for each in settings for word in ("--set", each))]
    for command in (("check", "--budget", "2"), ("run", "--no-record", "--process", "alpha")):
        done = CliRunner().invoke(app, [command[0], *words, *command[1:]])
        assert done.exit_code == 2, done.output
        assert said in " ".join(done.output.split())
        assert "mission.toml" not in done.output, "the command line is to blame"


@pytest.mark.pybullet
def test_a_map_of_more_boxes_than_pybullet_takes_is_refused_before_a_world_is_built(tmp_path: Path) -> None:
    cells = np.where(np.random.default_rng(1).random((300, 300)) < 0.2, 0, 254).astype(np.uint8)
    cells[:60, :60] = 254  # north-west: room for a station
    (tmp_path / "noise.pgm").write_bytes(b"P5 300 300 255\n" + cells.tobytes())
    (tmp_path / "noise.yaml").write_text(
        "image: noise.pgm\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.2\n"
    )
    station = "[[station]]\nx_m = 2.0\ny_m = 28.0\nside_m = 0.5\n"
    (tmp_path / "mission.toml").write_text(f'workspace = "noise.yaml"\nbackend = "pybullet"\n{station}')
    for command in (("check", "--budget", "2"), ("run", "--no-record", "--duration", "1")):
        done = CliRunner().invoke(app, [command[0], str(tmp_path / "mission.toml"), *command[1:]])
        assert done.exit_code == 2, done.output
        assert re.search(
            r"backends.pybullet.engine: it is 'pybullet', allowed: kinematic, since .* \d{5} boxes", done.output
        )
