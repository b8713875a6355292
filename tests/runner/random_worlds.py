"""Worlds drawn at random, polygons and maps: robots keep every rule in them, or the mission is refused.

python -m tests.runner.random_worlds --count 200
"""

from __future__ import annotations

import argparse
import random
import tempfile
from collections import Counter
from pathlib import Path

from PIL import Image

from soter.config import load_mission
from soter.config.toml_text import toml
from soter.errors import ConfigError, IllFormedModule
from soter.geometry.draft import site_of
from soter.geometry.grid import GridMap
from soter.geometry.writing import as_tables
from soter.runner import run_mission
from tests.geometry.drawn import drawn
from tests.geometry.slam import CELL_M, FREE, Wall, drawn_map

_ROBOTS = 3
_CLEAR_M = 0.6


def outcome(seed: int, folder: Path, duration_s: float = 60.0) -> str:
    """Return what becomes of a mission in a world: `kept`, or why it was refused.

    Raises:
        AssertionError: a rule was broken, or the run failed.
    """
    mission = folder / "mission.toml"
    tables = {
        "mission": "surveillance", "backend": "kinematic", "targets": "hostile", "planner": "straight-line",
        "seed": seed, "duration_s": duration_s, "target_timeout_s": 60.0,
        "battery": {"drive_s": 14400.0, "idle_s": 57600.0, "charge_s": 120.0},
    }  # fmt: skip
    try:
        if seed % 2:
            tables |= _map(seed, folder)
        else:
            site = site_of(drawn(seed), phi_safer_m=0.1, spacing_m=0.5)
            (folder / "world.toml").write_text(toml(as_tables(site)))
            tables["workspace"] = "world.toml"
        mission.write_text(toml(tables))
        result = run_mission(load_mission(mission)).result
    except (ConfigError, IllFormedModule) as refused:
        return str(refused).splitlines()[0]
    assert result.status == "completed", result.failure
    assert result.violations is not None
    assert not any(result.violations.values()), result.violations
    return "kept"


def _map(seed: int, folder: Path) -> dict[str, object]:
    """Draw the map of a building, and return what a mission says of it."""
    stream = random.Random(f"map/{seed}")
    wide, deep = stream.uniform(3.0, 6.0), stream.uniform(3.0, 6.0)
    walls: list[Wall] = [
        (0.3, 0.3, 0.3 + wide, 0.45), (0.3, 0.15 + deep, 0.3 + wide, 0.3 + deep),
        (0.3, 0.3, 0.45, 0.3 + deep), (0.15 + wide, 0.3, 0.3 + wide, 0.3 + deep),
    ]  # fmt: skip
    for _ in range(stream.randint(0, 4)):
        x, y = stream.uniform(0.3, wide), stream.uniform(0.3, deep)
        long, thick = stream.uniform(0.1, 1.5), stream.uniform(0.1, 0.4)
        walls.append((x, y, x + long, y + thick) if stream.random() < 0.5 else (x, y, x + thick, y + long))
    picture = drawn_map(walls, (wide + 0.6, deep + 0.6), seed)
    Image.fromarray(picture).save(folder / "map.png")
    origin = [stream.uniform(-9000.0, 9000.0), stream.uniform(-9000.0, 9000.0), stream.uniform(-3.0, 3.0)]
    (folder / "map.yaml").write_text(
        f"image: map.png\nresolution: {CELL_M}\norigin: {origin}\nnegate: 0\n"
        f"occupied_thresh: 0.65\nfree_thresh: 0.196\nunknown: {stream.choice(('obstacle', 'obstacle', 'free'))}\n"
    )
    rows, columns = picture.shape
    grid = GridMap(columns, rows, CELL_M, origin[0], origin[1], origin[2], "")
    taken: list[tuple[float, float]] = []
    reach = round(_CLEAR_M / CELL_M)
    for _ in range(400):
        column, row = stream.randrange(reach, columns - reach), stream.randrange(reach, rows - reach)
        around = picture[::-1][row - reach : row + reach, column - reach : column + reach]
        far = all((column - one) ** 2 + (row - other) ** 2 > (1.0 / CELL_M) ** 2 for one, other in taken)
        if far and (around == FREE).all() and len(taken) < _ROBOTS:
            taken.append((column, row))
    stations = [grid.corner(*at) for at in taken]
    return {"workspace": "map.yaml", "station": [{"x_m": x, "y_m": y} for x, y in stations]}


def main() -> None:
    """Run worlds and count what became of them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    given = parser.parse_args()
    found: Counter[str] = Counter()
    for seed in range(given.first, given.first + given.count):
        with tempfile.TemporaryDirectory() as folder:
            try:
                said = outcome(seed, Path(folder))
            except AssertionError as broken:
                said = f"BROKEN: {broken}"
        print(seed, said, flush=True)
        found["kept" if said == "kept" else said.split(":")[0] if "BROKEN" in said else "refused"] += 1
    print(dict(found))


if __name__ == "__main__":
    main()
