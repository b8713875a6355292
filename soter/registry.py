"""Finds backends by name: built in, registered by an installed distribution, or a class as `module:Class`.

Adapters are imported only when they are needed, and vendor libraries only when a backend is opened or its adapter needs
them.
"""

from __future__ import annotations

import importlib
import importlib.util
import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import Final

from soter.errors import BackendError, BackendUnavailable, UnknownBackend, nearest
from soter.hints import DISTRIBUTION, install_command
from soter.sdk import INTERFACE_VERSION, Backend, BackendConfig, Robot

ENTRY_POINT_GROUP: Final = "soter.adapters"

BUILT_IN: Final[Mapping[str, str]] = {
    "pybullet": "soter.adapters.pybullet:PyBulletBackend",
    "kinematic": "soter.adapters.pybullet:KinematicBackend",
    "mavlink": "soter.adapters.mavlink.backend:MavlinkBackend",
    "mavsdk": "soter.adapters.mavlink.mavsdk_backend:MavsdkBackend",
    "ros2": "soter.adapters.ros2.backend:Ros2Backend",
    "zenoh": "soter.adapters.zenoh.backend:ZenohBackend",
}
"""The built-in backends, found even if this distribution is not installed; registrations cannot replace them."""

LIBRARIES: Final[Mapping[str, str]] = {
    "pybullet": "pybullet",
    "ros2": "rclpy",
    "zenoh": "zenoh",
    "mavlink": "pymavlink",
    "mavsdk": "mavsdk",
}
"""Vendor libraries that built-in backends import only when they are opened."""

INSTALL_HINTS: Final[Mapping[str, str]] = {
    "pybullet": "pybullet",
    "ompl": "ompl",
    "matplotlib": "report",
    "av": "film",
    "pandas": "notebook",
    "foxglove": "foxglove",
    "pymavlink": "mavlink",
    "mavsdk": "mavlink",
    "rclpy": "ros2",
    "geometry_msgs": "ros2",
    "nav_msgs": "ros2",
    "sensor_msgs": "ros2",
    "std_msgs": "ros2",
    "rosgraph_msgs": "ros2",
    "diagnostic_msgs": "ros2",
    "zenoh": "zenoh",
    "cma": "campaign",
    "scipy": "campaign",
    "shapely": "campaign",
    "distributed": "cluster",
    "pycdr2": "zenoh",
    "cryptography": "sign",
    "pymap3d": "worlds",
    "yaml": "worlds",
    "PIL": "worlds",
}
"""By vendor library, the extra of this distribution that installs it."""


@dataclass(frozen=True, slots=True)
class BackendRow:
    """One line of `soter backends`.

    Attributes:
        name: the name for `--backend`.
        origin: "built in", or the distribution that registered it.
        target: its class, as `module:Class`.
        available: whether it can be opened here.
        problem: why it is not available, and what to do about it; empty if it is.
        capabilities: the promise of its robots, in a few words; empty if it is not known without the library.
    """

    name: str
    origin: str
    target: str
    available: bool
    problem: str
    capabilities: str


def install_hint(library: str) -> str | None:
    """Return the command that installs a vendor library, or None if no extra of ours has it."""
    extra = INSTALL_HINTS.get(library.partition(".")[0])
    return install_command(extra) if extra else None


def load_backend(name: str, *, to_open: bool = True) -> type[Backend]:
    """Import and return the class of a backend.

    Args:
        name: a built-in name, one that an installed distribution registered, or `module:Class`.
        to_open: whether the backend is to be opened; False needs no vendor library, to read its robots' promise.

    Raises:
        UnknownBackend: there is no backend of that name; the message lists those there are.
        BackendUnavailable: a library that it needs is missing; the message says what to install.
        BackendError: the object with that name is no backend for this version of the interface.
    """
    target, origin = _find(name)
    library = LIBRARIES.get(name)
    if to_open and library is not None and not _importable(library):
        raise _unavailable(name, library, f"the library '{library}' is not installed")
    return _checked(name, origin, target, _import(name, origin, target))


def in_virtual_time(name: str) -> bool:
    """Return whether a backend's robots run in virtual time; needs no vendor library. Raises BackendError."""
    return load_backend(name, to_open=False).robot_class.declared.in_process


def backend_names() -> list[str]:
    """Return the names of all registered backends, the built-in ones first."""
    return [*BUILT_IN, *sorted(_registered())]


def list_backends() -> list[BackendRow]:
    """Return every registered backend, and whether it can be opened here. A broken one affects only its own row."""
    rows = []
    for name in backend_names():
        target, origin = BUILT_IN.get(name, ""), "built in"
        try:
            target, origin = _find(name)
            backend, problem = load_backend(name), ""
        except BackendError as failure:
            backend, problem = None, str(failure)
            others = _registered().get(name, [])
            if not target and others:
                target, origin = others[0].value, ", ".join(_distribution(each) for each in others)
        rows.append(
            BackendRow(name, origin, target, backend is not None, problem, _summary(backend) if backend else "")
        )
    return rows


def missing_library(name: str, failure: ImportError) -> BackendUnavailable:
    """Return the error for a backend that fails to import a library while it is opened."""
    library = (failure.name or "").partition(".")[0]
    return _unavailable(name, library, str(failure), broken=not isinstance(failure, ModuleNotFoundError))


def _registered() -> dict[str, list[EntryPoint]]:
    """Return the registrations by name, without the built-in ones."""
    found: dict[str, list[EntryPoint]] = {}
    for entry in entry_points(group=ENTRY_POINT_GROUP):
        # The built-in ones are registered too, so that other programs can list them; their names cannot be taken.
        if entry.name not in BUILT_IN and entry not in found.get(entry.name, []):
            found.setdefault(entry.name, []).append(entry)
    return found


def _distribution(entry: EntryPoint) -> str:
    return entry.dist.name if entry.dist is not None else "an unknown distribution"


def _find(name: str) -> tuple[str, str]:
    if name in BUILT_IN:
        return BUILT_IN[name], "built in"
    registered = _registered()
    if entries := registered.get(name):
        if len({entry.value for entry in entries}) > 1:
            targets = " and ".join(f"'{entry.value}' ({_distribution(entry)})" for entry in entries)
            raise BackendError(
                f"backend '{name}' is registered more than once: {targets}; uninstall one of them, or name the class "
                "itself"
            )
        return entries[0].value, _distribution(entries[0])
    if ":" in name:
        return name, "given as a class"
    known = [*BUILT_IN, *sorted(registered)]
    raise UnknownBackend(
        f"unknown backend '{name}'{nearest(name, known)}; known are {', '.join(known)}, or a class as 'module:Class'"
    )


def _importable(library: str) -> bool:
    try:
        return importlib.util.find_spec(library) is not None
    except (ImportError, ValueError):
        return False


def _import(name: str, origin: str, target: str) -> object:
    # An entry point may carry extras behind its class: "module:Class [extra]".
    module_name, _, class_name = (part.strip() for part in target.partition("[")[0].partition(":"))
    parts = module_name.split(".")
    if not class_name.isidentifier() or not all(part.isidentifier() for part in parts):
        raise UnknownBackend(f"backend '{name}': '{target}' does not name a class; write it as 'module:Class'")
    try:
        module = importlib.import_module(module_name)
    except ModuleNotFoundError as failure:
        missing = failure.name or ""
        if missing == module_name or module_name.startswith(f"{missing}."):
            raise UnknownBackend(
                f"backend '{name}' ({origin}): there is no module '{missing}'; check its spelling, and that its "
                "distribution is installed in this environment"
            ) from failure
        raise _unavailable(name, missing, f"the library '{missing}' is not installed") from failure
    except ImportError as failure:
        raise _unavailable(name, failure.name or "", f"it cannot be imported: {failure}", broken=True) from failure
    except Exception as failure:  # foreign code may fail in any way while it is imported
        raise BackendError(
            f"backend '{name}' ({origin}): importing '{module_name}' failed with {type(failure).__name__}: {failure}; "
            "this is a fault of that module"
        ) from failure
    found: object = getattr(module, class_name, None)
    if found is None:
        classes = [key for key, value in vars(module).items() if isinstance(value, type)]
        raise UnknownBackend(
            f"backend '{name}' ({origin}): module '{module_name}' has no '{class_name}'{nearest(class_name, classes)}"
        )
    return found


def _unavailable(name: str, library: str, problem: str, *, broken: bool = False) -> BackendUnavailable:
    hint = install_hint(library)
    if hint is not None:
        advice = f"install it with: {hint}"
    elif library:
        advice = f"install {'another version of ' if broken else ''}'{library}' into this environment"
    else:
        advice = "install its distribution again"
    return BackendUnavailable(f"backend '{name}' is not available: {problem}; {advice}")


def _checked(name: str, origin: str, target: str, found: object) -> type[Backend]:
    """Return the object that was found, if it is a backend for this interface."""
    who = f"backend '{name}' ({origin}): '{target}'"
    if not (isinstance(found, type) and issubclass(found, Backend)):
        raise BackendError(f"{who} is not a subclass of soter.sdk.Backend; name the backend's class")
    # The version comes first: a class made for another interface may lack everything else.
    version = getattr(found, "interface_version", None)
    if not isinstance(version, int):
        raise BackendError(f"{who} does not say which interface it is made for; set interface_version to that number")
    if version != INTERFACE_VERSION:
        advice = "the adapter" if version < INTERFACE_VERSION else DISTRIBUTION
        raise BackendError(
            f"{who} is made for version {version} of the interface, this is version {INTERFACE_VERSION}; "
            f"upgrade {advice}"
        )
    # isabstract() also finds misspelt hooks, before anything is opened.
    if inspect.isabstract(found):
        missing = ", ".join(sorted(getattr(found, "__abstractmethods__", ())))
        raise BackendError(f"{who} is not complete: it does not define {missing}")
    for attribute, base in (("config_model", BackendConfig), ("robot_class", Robot)):
        value = getattr(found, attribute, None)
        if not (isinstance(value, type) and issubclass(value, base)):
            raise BackendError(f"{who} needs a '{attribute}' that is a subclass of soter.sdk.{base.__name__}")
    return found


def _summary(backend: type[Backend]) -> str:
    """Return the promise of a backend's robots, in a few words."""
    declared = getattr(backend.robot_class, "declared", None)
    if declared is None:
        return "declares nothing"
    words = [
        "in process, virtual time" if declared.in_process else "on a wire",
        "repeatable" if declared.deterministic else "not repeatable",
        f"at most {declared.v_max_m_s:g} m/s",
        f"latency {declared.latency_s:g} s",
        f"lease {declared.lease_s:g} s",
    ]
    optional = {
        "reverses": declared.reverses,
        "battery": declared.reports_battery,
        "reports the active controller": declared.reports_controller,
    }
    return ", ".join([*words, *(word for word, has in optional.items() if has)])
