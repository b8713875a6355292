"""Backends by name: where they come from, and what each kind of broken one is told."""

from __future__ import annotations

import importlib
import importlib.metadata
import subprocess
import sys
import textwrap
import tomllib
from collections.abc import Callable, Iterator
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path

import pytest

from soter import registry
from soter.errors import BackendError, BackendUnavailable, UnknownBackend
from soter.hints import DISTRIBUTION, install_command
from soter.registry import BUILT_IN, INSTALL_HINTS, LIBRARIES, backend_names, install_hint, list_backends, load_backend
from soter.sdk import INTERFACE_VERSION

PYPROJECT = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())

GOOD = """
    from soter.sdk import Backend, BackendConfig, Capabilities, Robot

    class R(Robot):
        declared = Capabilities(
            in_process=False, deterministic=False, reverses=True, reports_battery=True, reports_controller=False,
            v_max_m_s=0.5, yaw_rate_max_rad_s=1.0, brake_m_s2=1.0, body_radius_m=0.1, latency_s=0.1,
            sample_age_s=0.1, jitter_s=0.01, setpoint_period_s=0.05, lease_s=0.4, tube_m=0.05, overshoot_m=0.02,
            position_noise_m=0.0, pivots_first=True,
        )

    class B(Backend):
        interface_version = 1
        config_model = BackendConfig
        robot_class = R

        def open(self, config, robots):
            raise NotImplementedError
"""
Write = Callable[..., str]


@pytest.fixture
def write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Write]:
    """Writes a module that can be imported until the test ends, and returns its name."""
    monkeypatch.syspath_prepend(tmp_path)
    written: list[str] = []

    def write(text: str, name: str = "robots_of_somebody") -> str:
        (tmp_path / f"{name}.py").write_text(textwrap.dedent(text))
        importlib.invalidate_caches()
        written.append(name)
        return name

    yield write
    for name in written:
        sys.modules.pop(name, None)


@pytest.fixture
def register(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Replaces the entry points of this environment."""

    def register(**targets: str) -> None:
        entries = EntryPoints(
            EntryPoint(name.partition("__")[0], value, registry.ENTRY_POINT_GROUP) for name, value in targets.items()
        )
        monkeypatch.setattr(registry, "entry_points", lambda group: entries.select(group=group))

    return register


def failure(kind: type[BackendError], name: str) -> str:
    with pytest.raises(kind) as caught:
        load_backend(name)
    assert type(caught.value) is kind
    return str(caught.value)


# --- names -------------------------------------------------------------------------------------------------


def test_the_built_in_table_is_what_the_distribution_registers() -> None:
    assert PYPROJECT["project"]["entry-points"][registry.ENTRY_POINT_GROUP] == dict(BUILT_IN)
    assert PYPROJECT["project"]["name"] == DISTRIBUTION


def test_every_hint_names_an_extra_that_there_is() -> None:
    assert set(INSTALL_HINTS.values()) <= set(PYPROJECT["project"]["optional-dependencies"])
    assert set(LIBRARIES) <= set(BUILT_IN)
    assert set(LIBRARIES.values()) <= set(INSTALL_HINTS)


def test_install_hint() -> None:
    assert install_hint("pybullet") == install_command("pybullet")
    assert install_hint("ompl.base") == install_command("ompl")
    assert install_hint("antigravity") is None


def test_an_unknown_name_is_told_those_there_are(register: Callable[..., None]) -> None:
    register(zebra="zoo:Zebra")
    assert backend_names() == [*BUILT_IN, "zebra"]
    assert failure(UnknownBackend, "pybulet") == (
        f"unknown backend 'pybulet', did you mean 'pybullet'?; known are {', '.join(BUILT_IN)}, zebra, or a class as "
        "'module:Class'"
    )
    assert failure(UnknownBackend, "xyz").startswith("unknown backend 'xyz'; known are pybullet, ")


def test_a_class_is_found_as_module_and_class(write: Write) -> None:
    assert load_backend(f"{write(GOOD)}:B").__name__ == "B"


def test_a_registered_class_is_found_by_name(write: Write, register: Callable[..., None]) -> None:
    register(mine=f"{write(GOOD)}:B")
    assert load_backend("mine").__name__ == "B"


def test_an_entry_point_may_carry_extras(write: Write, register: Callable[..., None]) -> None:
    register(mine=f"{write(GOOD)}:B [fast]")
    assert load_backend("mine").__name__ == "B"


def test_the_names_of_the_built_in_ones_cannot_be_taken(register: Callable[..., None]) -> None:
    register(pybullet="zoo:Zebra")
    assert backend_names() == [*BUILT_IN]


def test_one_name_registered_for_two_classes(register: Callable[..., None]) -> None:
    register(mine__1="zoo:Zebra", mine__2="zoo:Lion")
    assert failure(BackendError, "mine") == (
        "backend 'mine' is registered more than once: 'zoo:Zebra' (an unknown distribution) and 'zoo:Lion' (an unknown "
        "distribution); uninstall one of them, or name the class itself"
    )
    row = list_backends()[-1]
    assert (row.name, row.target, row.available) == ("mine", "zoo:Zebra", False)


# --- libraries ---------------------------------------------------------------------------------------------


def test_a_built_in_backend_without_its_library(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "_importable", lambda library: library != "pybullet")
    assert failure(BackendUnavailable, "pybullet") == (
        "backend 'pybullet' is not available: the library 'pybullet' is not installed; install it with: "
        + install_command("pybullet")
    )


def test_a_library_of_ours_that_is_missing(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ompl", None)
    name = f"{write('import ompl.base')}:B"
    assert failure(BackendUnavailable, name).endswith(f"; install it with: {install_command('ompl')}")


def test_a_library_of_somebody_that_is_missing(write: Write) -> None:
    name = f"{write('import no_such_sdk.robots')}:B"
    assert failure(BackendUnavailable, name) == (
        f"backend '{name}' is not available: the library 'no_such_sdk' is not installed; install 'no_such_sdk' into "
        "this environment"
    )


def test_a_library_that_is_broken(write: Write) -> None:
    name = f"{write('from json import no_such_name')}:B"
    message = failure(BackendUnavailable, name)
    assert message.startswith(f"backend '{name}' is not available: it cannot be imported: cannot import name 'no_such_")
    assert message.endswith("; install another version of 'json' into this environment")
    name = write("raise ImportError('libxyz.so.6: cannot open shared object file')", "other") + ":B"
    assert failure(BackendUnavailable, name) == (
        f"backend '{name}' is not available: it cannot be imported: libxyz.so.6: cannot open shared object file; "
        "install its distribution again"
    )


def test_a_library_that_is_missed_only_when_the_backend_is_opened() -> None:
    with pytest.raises(ImportError) as missing:
        importlib.import_module("no_such_sdk.robots")
    made = registry.missing_library("mine", missing.value)
    assert str(made).startswith("backend 'mine' is not available: No module named 'no_such_sdk'; install 'no_such_sdk'")


# --- broken ones -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "kind", "expected"),
    [
        ("B = 3", BackendError, "is not a subclass of soter.sdk.Backend; name the backend's class"),
        ("class B: pass", BackendError, "is not a subclass of soter.sdk.Backend; name the backend's class"),
        ("from soter.sdk import Robot as B", BackendError, "is not a subclass of soter.sdk.Backend"),
        ("class Bee: pass", UnknownBackend, "module 'robots_of_somebody' has no 'B'"),
        (
            GOOD.replace("interface_version = 1", f"interface_version = {INTERFACE_VERSION + 1}"),
            BackendError,
            (
                f"is made for version {INTERFACE_VERSION + 1} of the interface, this is version {INTERFACE_VERSION}; "
                "upgrade soter-rta"
            ),
        ),
        (
            GOOD.replace("interface_version = 1", f"interface_version = {INTERFACE_VERSION - 1}"),
            BackendError,
            (
                f"is made for version {INTERFACE_VERSION - 1} of the interface, this is version {INTERFACE_VERSION}; "
                "upgrade the adapter"
            ),
        ),
        (
            GOOD.replace("interface_version = 1", ""),
            BackendError,
            "does not say which interface it is made for; set interface_version to that number",
        ),
        (GOOD.replace("def open", "def opne"), BackendError, "is not complete: it does not define open"),
        (
            GOOD.replace("robot_class = R", ""),
            BackendError,
            "needs a 'robot_class' that is a subclass of soter.sdk.Robot",
        ),
        (
            GOOD.replace("config_model = BackendConfig", "config_model = dict"),
            BackendError,
            "needs a 'config_model' that is a subclass of soter.sdk.BackendConfig",
        ),
        (
            "1 / 0",
            BackendError,
            (
                "importing 'robots_of_somebody' failed with ZeroDivisionError: division by zero; this is "
                "a fault of that "
                "module"
            ),
        ),
        ("def broken(:", BackendError, "importing 'robots_of_somebody' failed with SyntaxError: "),
    ],
)
def test_a_broken_backend_is_told_what_is_wrong(
    write: Write, text: str, kind: type[BackendError], expected: str
) -> None:
    name = f"{write(text)}:B"
    message = failure(kind, name)
    assert message.startswith(f"backend '{name}' (given as a class): ")
    assert expected in message


@pytest.mark.parametrize("name", [":", ":B", "a:", "a b:C", "a..b:C", "a:C d", "a:b.c", "../a:B", "a:B:C", "a-b:C"])
def test_what_names_no_class(name: str) -> None:
    assert failure(UnknownBackend, name).endswith("does not name a class; write it as 'module:Class'")


@pytest.mark.parametrize("name", ["no_such_module:B", "no_such.module:B", "json.no_such:B"])
def test_a_module_that_is_not_there(name: str) -> None:
    message = failure(UnknownBackend, name)
    assert "there is no module 'no_such" in message or "there is no module 'json.no_such'" in message


# --- the list ----------------------------------------------------------------------------------------------


def test_the_list_shows_who_is_available_and_why_not(write: Write, register: Callable[..., None]) -> None:
    register(
        good=f"{write(GOOD)}:B",
        missing=f"{write('import no_such_sdk', 'needs_sdk')}:B",
        broken=f"{write('1 / 0', 'divides')}:B",
    )
    rows = {row.name: row for row in list_backends()}
    assert list(rows) == [*BUILT_IN, "broken", "good", "missing"]
    assert rows["pybullet"].origin == rows["kinematic"].origin == "built in"
    good = rows["good"]
    assert (good.origin, good.target, good.available, good.problem) == (
        "an unknown distribution",
        "robots_of_somebody:B",
        True,
        "",
    )
    assert good.capabilities == (
        "on a wire, not repeatable, at most 0.5 m/s, latency 0.1 s, lease 0.4 s, reverses, battery"
    )
    assert not rows["missing"].available
    assert "install 'no_such_sdk'" in rows["missing"].problem
    assert not rows["broken"].available
    assert "ZeroDivisionError" in rows["broken"].problem
    assert rows["broken"].capabilities == ""


def test_a_real_registration_names_its_distribution(tmp_path: Path, write: Write) -> None:
    write(GOOD)
    folder = tmp_path / "somebodys_robots-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: somebodys-robots\nVersion: 1.0\n")
    (folder / "entry_points.txt").write_text("[soter.adapters]\nmine = robots_of_somebody:B\n")
    importlib.invalidate_caches()
    row = next(row for row in list_backends() if row.name == "mine")
    assert (row.origin, row.available) == ("somebodys-robots", True)


def test_the_registry_itself_loads_no_vendor_library() -> None:
    code = "import sys, soter.registry; print(sorted({'pybullet', 'ompl', 'matplotlib'} & set(sys.modules)))"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert found.stdout.strip() == "[]"
