"""Missions of the examples on real ArduPilots: starting those, running it, and letting something happen on the way."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from soter.config import MissionFile, load_mission
from soter.geometry.earth import Projection
from soter.geometry.site import GeoOrigin
from soter.sdk import RobotSpec, RuleLimits
from tests.autopilot.ardupilot import ORIGIN, Autopilots
from tests.autopilot.seen import Seen, seen

EXAMPLES: Final = Path(__file__).resolve().parents[2] / "examples"
REST_S: Final = 4.0
READY_S: Final = 45.0
"""All are armed within this time: an EKF takes 43 s, and little may come on top."""
SEEN_S: Final = 1.0
"""What takes a vehicle away from SOTER is seen within this time."""

MOVES_M_S: Final = 0.05
FAST_M_S: Final = 0.6
RULES: Final = {"battery": 0, "geofence": 0, "collision": 0, "obstacle": 0}

# Simulated accelerometers count as calibrated by these.
CALIBRATED: Final = {
    **{f"INS_ACC{number}OFFS_{axis}": 0.001 for number in ("", "2") for axis in "XYZ"},
    **{f"INS_ACC{number}SCAL_{axis}": 1.001 for number in ("", "2") for axis in "XYZ"},
}


@dataclass(frozen=True)
class Example:
    """A mission for vehicles outdoors.

    Attributes:
        folder: of examples/.
        model: of the simulator.
        parameters: what its vehicles need beside what the example sets.
        file: the mission file, where it is not the example's.
        current_m_s: see `Autopilots`.
    """

    folder: str
    model: str
    parameters: dict[str, float]
    file: Path | None = None
    current_m_s: tuple[float, float] | None = None

    @property
    def path(self) -> Path:
        """The mission file."""
        return self.file or EXAMPLES / self.folder / "mission.toml"

    @property
    def mission(self) -> MissionFile:
        """What it says."""
        return load_mission(self.path)

    @property
    def promise(self) -> dict[str, Any]:
        """What its vehicles promise."""
        return dict(self.mission.backends["mavlink"]["promise"])

    @property
    def unheard_m(self) -> float:
        """How far a vehicle may go on when nobody is heard any more, by what is promised."""
        promise = self.promise
        v_m_s, brake_m_s2 = promise["v_max_m_s"], promise["brake_m_s2"]
        unheard_s = sum(promise[name] for name in ("lease_s", "latency_s", "setpoint_period_s", "jitter_s"))
        return float(v_m_s * unheard_s + v_m_s**2 / (2.0 * brake_m_s2) + promise["overshoot_m"])

    def start(self, program: str, folder: Path, robots: int | None = None) -> Autopilots:
        """Start its vehicles, or the first of them: one that is not driven would stand in the way of the others."""
        mission = self.mission
        workspace = mission.read_workspace()
        lines = [line.split() for line in (EXAMPLES / self.folder / f"{self.folder}.parm").read_text().splitlines()]
        return Autopilots(
            Path(program), folder, workspace,
            [RobotSpec(place.id, place.x_m, place.y_m, 0.3 * place.id) for place in workspace.robots[:robots]],
            model=self.model,
            parameters=self.parameters | {line[0]: float(line[1]) for line in lines if line and line[0] != "#"},
            limits=RuleLimits(mission.rta.collision.phi_safe_m, mission.rta.obstacle.phi_safe_m),
            current_m_s=self.current_m_s,
        )  # fmt: skip


def drawn_on_a_map(example: Example, folder: Path, origin: GeoOrigin) -> Example:
    """Return an example whose field is one of places on earth, where it was, seen from an origin anywhere."""
    field = Projection(GeoOrigin(ORIGIN.lat_deg, ORIGIN.lon_deg), "field")

    def feature(kind: str, *corners: tuple[float, float]) -> dict[str, Any]:
        places = [field.place(*corner)[::-1] for corner in corners]
        shape: dict[str, Any] = {"type": "Point", "coordinates": places[0]}
        if len(places) > 1:
            shape = {"type": "Polygon", "coordinates": [[*places, places[0]]]}
        return {"type": "Feature", "properties": {"soter": kind, "height_m": 1.0}, "geometry": shape}

    workspace = example.mission.read_workspace()
    fence, keep_outs = workspace.outlines()
    features = [feature("fence", *(fence or ())), *(feature("keep_out", *ring) for ring in keep_outs)]
    features += [feature("station", place.charger.centre) for place in workspace.robots]
    world = folder / "field.geojson"
    world.write_text(json.dumps(
        {"type": "FeatureCollection", "origin": [origin.lon_deg, origin.lat_deg], "features": features}
    ))  # fmt: skip
    text = "".join(
        line for line in example.path.read_text().splitlines(keepends=True) if not line.startswith("origin = ")
    )
    file = folder / "drawn.toml"
    file.write_text(text.replace("field.xml", str(world)))
    return replace(example, file=file)


@dataclass(frozen=True)
class Ended:
    """How a run ended.

    Attributes:
        code: its exit code.
        result: what `--json` wrote; empty where it wrote nothing.
        top_m_s: the top speed of any rover, by the truth.
        way_m: how far robot 1 went on after `happens` was called.
        ready_s: from the start of SOTER, which is that of the vehicles, until all were armed.
        seen: what SOTER saw of robot 1 since `happens` was called.
    """

    code: int
    result: dict[str, Any]
    top_m_s: float
    way_m: float
    ready_s: float
    seen: Seen


def run(
    example: Example,
    vehicles: Autopilots,
    folder: Path,
    duration_s: float,
    happens: Callable[[subprocess.Popen[bytes]], object] | None = None,
    backend: str = "mavlink",
    options: Sequence[str] = (),
) -> Ended:
    """Run a mission on its vehicles; let something happen once robot 1 has been fast for a while."""
    file, recording = folder / "result.json", folder / "run.mcap"
    reached = {"truth": vehicles.truth, "connection": f"udpin:127.0.0.1:{vehicles.port}"}
    settings = [word for key, value in reached.items() for word in ("--set", f"backends.mavlink.{key}={value}")]
    # A busy host may hold up the mission's process; it is the vehicles that are on trial here.
    settings += ["--set", "isolation.silent_s=30"]
    text = example.path.read_text().replace("field.xml", str(example.path.with_name("field.xml")))
    mission = folder / "mission.toml"
    mission.write_text(text.replace("mavlink", backend))
    settings = [word.replace("mavlink", backend) for word in settings]
    process = subprocess.Popen(
        [sys.executable, "-m", "soter.cli", "run", mission, "--targets", "hostile", "--duration", str(duration_s),
         *(["--no-record"] if happens is None else ["--record", recording]), "--quiet", "--json", file,
         *settings, *options],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    began_s = now_s = time.perf_counter()
    ready_s = happened_s = happened_at_s = rest_s = math.nan
    top_m_s, fast_s, ended_s, at = 0.0, math.inf, math.inf, (math.nan, math.nan)
    while now_s < ended_s + REST_S:
        time.sleep(0.02)
        ended_s = min(ended_s, now_s) if process.poll() is not None else math.inf
        now_s, (x_m, y_m, _, v_m_s) = time.perf_counter(), vehicles.seen.get(1, (0.0, 0.0, 0.0, 0.0))
        if math.isnan(ready_s) and all(vehicles.armed(robot_id) for robot_id in vehicles.processes):
            ready_s = now_s - began_s
        top_m_s = max([top_m_s, *(abs(each[3]) for each in vehicles.seen.values())])
        fast_s = min(fast_s, now_s) if abs(v_m_s) > FAST_M_S else fast_s
        if happens is not None and now_s - fast_s > 10.0 and abs(v_m_s) > FAST_M_S:
            at, happened_s, happened_at_s = (x_m, y_m), now_s, time.time()
            happens(process)
            happens = None
        if now_s > happened_s and abs(v_m_s) > MOVES_M_S:
            rest_s = now_s - happened_s
    assert vehicles.processes.keys() <= vehicles.seen.keys(), "a vehicle told the witness no SIM_STATE"
    way_m = math.dist(at, vehicles.seen[1][:2])
    result = json.loads(file.read_text()) if file.exists() else {}
    saw = Seen()
    if result and not math.isnan(happened_at_s):
        saw = seen(recording, result, 1, happened_at_s, vehicles.paths[1], example.promise["sample_age_s"])
    said = ("ac_share", "longest_stall_s", "longest_without_ac_s", "violations", "min_margin", "uncontrolled")
    print(f"\nready {ready_s:.1f} s, load {os.getloadavg()[0]:.1f}, exit {process.returncode}, top {top_m_s:.2f} m/s,",
          f"seen after {saw.after_s:.2f} s, nobody's after {saw.nobodys_after_s:.2f} s, off by {saw.off_m:.2f} m,",
          f"last moved after {rest_s:.2f} s, way {way_m:.2f} m, driven on at {saw.top_m_s:.2f} m/s at most",
          {key: result.get(key) for key in said}, result.get("targets"), flush=True)  # fmt: skip
    return Ended(process.returncode, result, top_m_s, way_m, ready_s, saw)


def lost(ended: Ended, *, silent: bool = False, noise_m: float = 0.0) -> dict[str, Any]:
    """Check that SOTER soon saw that robot 1 did not obey any more, and that no rule was broken.

    Args:
        ended: how the run ended.
        silent: whether the robot fell silent: the age of its samples takes its AC from it, and it is nobody's only when
            it has not been heard of for 3 s.
        noise_m: what is seen later will do if its position was off by no more than this until then.

    Returns:
        What the result says of its time without control.
    """
    assert (ended.code, ended.result["violations"]) == (3, RULES)
    after_s = ended.seen.after_s if silent else ended.seen.nobodys_after_s
    assert after_s >= 0.0
    assert after_s <= SEEN_S or ended.seen.off_m <= noise_m
    return dict(ended.result["uncontrolled"]["1"])
