"""Which part of SOTER may import which: the picture of the house in docs/design.md, as a test.

A part may import what its line here lists, the base and itself. Local imports and those for type checking
count as much as the others: a type that a part may not know is a dependency too.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import pytest

from tests.project import imports
from tests.project.source import PACKAGES, ROOT, module_name, python_files

# Every part, and what it may import besides the base and itself. A name covers the modules below it.
ALLOWED: dict[str, set[str]] = {
    "soter.clock": set(),
    "soter.controller": set(),
    "soter.errors": set(),
    "soter.hints": set(),
    "soter.lazy": set(),
    "soter.loading": set(),
    "soter.problems": set(),
    "soter.scratch": set(),
    "soter.geometry": set(),
    "soter.config": set(),
    "soter.sdk": {"soter.onboard"},
    "soter.onboard": set(),
    "soter.isolation.sandbox": set(),
    "soter.isolation.child": {"soter.isolation.sandbox"},
    "soter.isolation.refused": set(),
    "soter.isolation": {"soter.rta", "soter.sdk"},
    "soter.distribution": {"soter.isolation", "soter.rta", "soter.sdk"},
    "soter.machine": set(),
    "soter.rta": {"soter.machine"},
    "soter.registry": {"soter.sdk"},
    "soter.faults": {"soter.sdk"},
    "soter.specs": {"soter.registry", "soter.faults", "soter.stack.planners", "soter.sdk"},
    "soter.adapters": set(),
    "soter.adapters.velocity_controlled": {"soter.sdk", "soter.onboard"},
    "soter.adapters.velocity_controlled.harness": {
        "soter.adapters.velocity_controlled",
        "soter.sdk",
        "soter.conformance",
    },
    "soter.adapters.pybullet": {"soter.sdk", "soter.onboard", "soter_sim"},
    "soter.adapters.mavlink": {"soter.sdk", "soter.onboard"},
    "soter.adapters.mavlink.harness": {"soter.adapters.mavlink", "soter.sdk", "soter.conformance"},
    "soter.adapters.ros2": {"soter.sdk", "soter.onboard", "soter.adapters.velocity_controlled"},
    "soter.adapters.ros2.harness": {
        "soter.adapters.ros2",
        "soter.adapters.velocity_controlled.harness",
        "soter.sdk",
        "soter.onboard",
        "soter.conformance",
    },
    "soter.adapters.zenoh": {"soter.sdk", "soter.onboard", "soter.adapters.velocity_controlled"},
    "soter.adapters.zenoh.harness": {
        "soter.adapters.zenoh",
        "soter.adapters.velocity_controlled",
        "soter.adapters.velocity_controlled.harness",
        "soter.sdk",
        "soter.conformance",
    },
    "soter.stack": {
        "soter.isolation.child",
        "soter.isolation.refused",
        "soter.isolation.sandbox",
        "soter.machine",
        "soter.rta",
        "soter.sdk",
    },
    "soter.controllers": {"soter.stack", "soter.rta", "soter.sdk", "soter.onboard"},
    # What admits a mission, and tries its modules in worlds of its own. A run asks it; it knows no run.
    "soter.check": {
        "soter.faults",
        "soter.machine",
        "soter.registry",
        "soter.rta",
        "soter.sdk",
        "soter.specs",
        "soter.stack",
    },
    "soter.conformance": {"soter.isolation.child", "soter.sdk", "soter.registry", "soter.faults"},
    "soter.record": {"soter.rta", "soter.machine", "soter.sdk"},
    "soter.report": {"soter.record"},
    "soter.live": {"soter.isolation.child", "soter.record", "soter.report"},
    "soter.missions": {"soter.stack", "soter.rta", "soter.machine", "soter.sdk"},
    "soter.runner": {
        "soter.controllers",
        "soter.missions",
        "soter.check",
        "soter.record",
        "soter.faults",
        "soter.registry",
        "soter.distribution",
        "soter.isolation",
        "soter.specs",
        "soter.stack",
        "soter.rta",
        "soter.machine",
        "soter.sdk",
    },
    # Studies: none knows another.
    "soter.replay": {"soter.record", "soter.stack", "soter.rta", "soter.sdk"},
    "soter.ablation": {"soter.runner", "soter.controllers", "soter.sdk"},
    # One run for scripts and notebooks.
    "soter.interactive": {"soter.missions", "soter.runner", "soter.record", "soter.registry", "soter.report"},
    "soter.campaign": {"soter.runner", "soter.record", "soter.report", "soter.registry", "soter.sdk"},
    # Draws from all that there is, and watches the simulated robots with eyes of its own.
    "soter.campaign.random": {
        "soter.campaign",
        "soter.controllers",
        "soter.adapters.pybullet",
        "soter.faults",
        "soter.registry",
        "soter.rta",
        "soter.runner",
        "soter.sdk",
        "soter.specs",
        "soter.onboard",
        "soter.stack",
        "soter_sim",
    },
    "soter.cli": {"soter", "soter_sim"},
    "soter": {"soter"},
    "soter_sim": {"soter.sdk.values", "soter.onboard"},
    # Its face on Zenoh speaks as the adapter does: one codec and one way to open a session, not two.
    # Its face on ROS 2 runs in the adapter's executor.
    "soter_sim.ros2": {"soter.adapters.ros2.executor", "soter.sdk.values", "soter.onboard", "soter_sim"},
    "soter_sim.zenoh": {
        "soter.adapters.zenoh.messages",
        "soter.adapters.zenoh.options",
        "soter.adapters.zenoh.talk",
        "soter.adapters.zenoh.programs",
        "soter.adapters.zenoh.session",
        "soter.sdk.values",
        "soter.onboard",
        "soter_sim",
    },
}
BASE = {
    "soter.controller",
    "soter.scratch",
    "soter.clock",
    "soter.errors",
    "soter.hints",
    "soter.lazy",
    "soter.loading",
    "soter.problems",
    "soter.geometry",
    "soter.config",
}
# These run where nothing is installed, or must stay easy to argue about; what they import must be so as well.
STDLIB_ONLY = {
    "soter.clock",
    "soter.controller",
    "soter.errors",
    "soter.hints",
    "soter.lazy",
    "soter.loading",
    "soter.onboard",
    "soter.isolation.child",
    "soter.isolation.sandbox",
    "soter.machine",
    "soter.scratch",
}

ROS2 = {"soter.adapters.ros2", "soter_sim.ros2"}
ZENOH = {"soter.adapters.zenoh", "soter_sim.zenoh"}

# Where a library may be imported that is not Python's own; `None` is anywhere but in STDLIB_ONLY.
LIBRARIES: dict[str, set[str] | None] = {
    "numpy": None,
    "pydantic": None,
    "pydantic_core": None,  # a part of pydantic: the details of its errors
    "typing_extensions": None,
    "defusedxml": {"soter.campaign.random.room", "soter.geometry.kml", "soter.geometry.xml_tree"},
    "msgspec": {
        "soter.check.trial",
        "soter.conformance.worker",
        "soter.distribution",
        "soter.isolation",
        "soter.record",
        "soter.sdk.wire",  # worlds, for the programs of simulated robots
        "soter.stack.planners.worker",
        "soter_sim.program",
    },
    "mcap": {"soter.record"},
    "cryptography": {"soter.record.signing"},
    "zstandard": {"soter.record"},  # what mcap compresses with, for its errors
    "typer": {"soter.cli"},
    "rich": {"soter.cli"},
    "pybullet": {"soter.adapters.pybullet", "soter_sim"},
    "pymavlink": {"soter.adapters.mavlink", "soter_sim"},
    "mavsdk": {"soter.adapters.mavlink"},
    "rclpy": ROS2,
    "rcl_interfaces": ROS2,
    "std_msgs": ROS2,
    "geometry_msgs": ROS2,
    "nav_msgs": ROS2,
    "sensor_msgs": ROS2,
    "rosgraph_msgs": ROS2,
    "diagnostic_msgs": ROS2,
    "zenoh": ZENOH,
    "pycdr2": {"soter.adapters.zenoh.messages"},
    "ompl": {"soter.stack.planners"},
    "matplotlib": {"soter.report"},
    "pandas": {"soter.interactive"},
    "foxglove": {"soter.live"},
    "scipy": {
        "soter.campaign.intervals",
        # Where a map is prepared; never in a tick.
        "soter.geometry.clearance",
        "soter.stack.map_routes",
    },
    "shapely": {
        "soter.campaign.random",
        # Where a workspace is read and prepared; never in a tick.
        "soter.geometry.decompose",
        "soter.geometry.draft",
        "soter.stack.site_routes",
    },
    "pymap3d": {"soter.geometry.earth"},
    "cma": {"soter.campaign.search"},
    "distributed": {"soter.campaign.cluster"},
    "av": {"soter.report.mp4"},
    "PIL": {"soter.geometry.ros_map", "soter.report"},  # what matplotlib writes pictures with
    "yaml": {"soter.geometry.ros_map"},
}
# Libraries of a backend, a planner or an output. Outside the adapters and the simulation, each of them is
# known to one module only.
VENDORS = {
    "pybullet",
    "pymavlink",
    "mavsdk",
    "rclpy",
    "zenoh",
    "pycdr2",
    "ompl",
    "matplotlib",
    "pandas",
    "foxglove",
    "cma",
    "distributed",
}
MANY_MODULES = {"soter.adapters", "soter.report", "soter_sim"}


def below(module: str, names: set[str]) -> bool:
    """Whether a module is one of the named ones or inside one of them."""
    return any(module == name or module.startswith(f"{name}.") for name in names)


def part_of(module: str) -> str | None:
    """The part of the table that a module belongs to: the longest name that covers it.

    `soter` itself is the facade; it covers no other module, so that a new folder has to enter the table.
    """
    covering = [part for part in ALLOWED if module == part or (part != "soter" and below(module, {part}))]
    return max(covering, key=len, default=None)


def allowed_within(part: str) -> set[str]:
    """The SOTER modules that a part may import."""
    base = BASE & STDLIB_ONLY if part in STDLIB_ONLY else BASE
    return ALLOWED[part] | base | {part}


def verdict(module: str, target: str) -> str | None:
    """Why a module of a part may not import a target, or None if it may."""
    part = part_of(module)
    assert part is not None
    root = target.partition(".")[0]
    if root in PACKAGES:
        # The facade leads everywhere, so it is no name for a part to import by; only the command line may.
        hidden = target == "soter" and part not in {"soter.cli", "soter"}
        return None if below(target, allowed_within(part)) and not hidden else f"may not import {target}"
    if root in sys.stdlib_module_names:
        return None
    if part in STDLIB_ONLY:
        return f"may import the standard library only, not {target}"
    if root not in LIBRARIES:
        return f"imports {target}, a library that LIBRARIES does not know"
    homes = LIBRARIES[root]
    return None if homes is None or below(module, homes) else f"may not import {target}; only {sorted(homes)} may"


def everything() -> list[tuple[Path, str, imports.Import]]:
    """Every import of both packages, with its file and module."""
    return [
        (path.relative_to(ROOT), module_name(path), found)
        for path in python_files(*PACKAGES.values())
        for found in imports.read(path)
    ]


def test_every_module_belongs_to_a_part() -> None:
    homeless = [name for path in python_files(*PACKAGES.values()) if not part_of(name := module_name(path))]
    assert not homeless, f"enter {homeless} into ALLOWED here and into docs/design.md"


def test_every_part_is_there() -> None:
    modules = {module_name(path) for path in python_files(*PACKAGES.values())}
    assert not set(ALLOWED) - modules, "take parts that are gone out of ALLOWED"


def test_every_import_follows_the_arrows() -> None:
    wrong = [
        f"{path}:{found.line}: {module} {why}"
        for path, module, found in everything()
        if part_of(module) and (why := verdict(module, found.target))
    ]
    assert not wrong, "\n" + "\n".join(wrong)


def test_a_vendor_library_is_known_to_one_module() -> None:
    known: defaultdict[str, set[str]] = defaultdict(set)
    for _, module, found in everything():
        root = found.target.partition(".")[0]
        if root in VENDORS and not below(module, MANY_MODULES):
            known[root].add(module)
    crowded = {library: sorted(modules) for library, modules in known.items() if len(modules) > 1}
    assert not crowded


@pytest.mark.parametrize(
    ("module", "target", "passes"),
    [
        ("soter.rta.monitor", "soter.machine.core", True),
        ("soter.rta.monitor", "soter.sdk", False),
        ("soter.machine.core", "soter.errors", True),
        ("soter.machine.core", "soter.geometry", False),
        ("soter.machine.core", "numpy", False),
        ("soter.rta.monitor", "soter", False),
        ("soter.adapters.zenoh.backend", "soter_sim.world", False),
        ("soter.adapters.pybullet.backend", "soter_sim.world", True),
        ("soter.adapters.mavlink.robot", "soter.adapters.zenoh", False),
        ("soter_sim.world", "soter.sdk.values", True),
        ("soter_sim.world", "soter.sdk.robot", False),
        ("soter.stack.agent", "ompl.base", False),
        ("soter.stack.agent", "requests", False),
    ],
)
def test_the_table_forbids_what_it_should(module: str, target: str, passes: bool) -> None:
    assert (verdict(module, target) is None) == passes


def test_every_way_to_import_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(PACKAGES, "soter", tmp_path)
    (tmp_path / "sdk").mkdir()
    (tmp_path / "sdk" / "values.py").touch()
    (tmp_path / "sdk" / "robot.py").write_text(
        "import os.path as p\n"
        "from soter.sdk import values, Robot\n"
        "from . import values\n"
        "from ..clock import Clock\n"
        "if TYPE_CHECKING:\n"
        "    import rclpy\n"
        "def f():\n"
        "    import zenoh\n"
        "    importlib.import_module('pybullet')\n"
    )
    found = sorted(imports.read(tmp_path / "sdk" / "robot.py"), key=lambda each: each.line)
    assert [each.target for each in found] == [
        "os.path",
        "soter.sdk.values",
        "soter.sdk",
        "soter.sdk.values",
        "soter.clock",
        "rclpy",
        "zenoh",
        "pybullet",
    ]


def test_importing_soter_loads_no_library_of_a_vendor() -> None:
    program = "import sys, soter; print(*sorted({name.partition('.')[0] for name in sys.modules}))"
    loaded = subprocess.run(
        [sys.executable, "-W", "error", "-c", program], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert not VENDORS & set(loaded.stdout.split())


@pytest.mark.parametrize("module", ["soter.stack.planners.sampling", "soter.stack.planners.worker", "soter_sim"])
def test_what_starts_in_processes_of_its_own_loads_only_what_it_needs(module: str) -> None:
    """A run waits for its planner's process, and every simulated robot is one."""
    program = f"import sys, {module}; print(*sorted(sys.modules))"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(ROOT), str(ROOT / "sim")))}
    loaded = subprocess.run(
        [sys.executable, "-W", "error", "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    assert not {"numpy", "xml.sax", "soter.config.mission_file", "soter.config.tables"} & set(loaded.stdout.split())
