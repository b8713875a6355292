"""The sandboxes of a mission's untrusted processes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from soter.config import MissionFile
from soter.controllers import MISSION
from soter.isolation.sandbox import SandboxRules
from soter.loading import file_of
from soter.runner.part import Part


def box_of(mission: MissionFile, part: Part | None = None) -> SandboxRules | None:
    """Return the sandbox rules of a mission's process, or of a planner; None if it is to have no sandbox.

    Args:
        mission: its `isolation` says whether there is a sandbox, and what may be read besides its own folder and those
            of its workspace and its script or controller.
        part: the part of a distributed mission in the process. Its machines talk to those of others over a bus, so it
            keeps the network and the files that the bus needs. Controllers do not use the bus.
    """
    if mission.isolation.sandbox == "off":
        return None
    read = [*mission.isolation.read, str(mission.workspace.parent)]
    if mission.source is not None:
        read.append(str(Path(mission.source).parent))
    read += [str(file.parent) for name in (mission.mission.use, mission.ac) if (file := file_of(name)) is not None]
    talks = part is not None and mission.ac == MISSION
    if part is not None and talks:
        table = mission.distribution
        read += _files({**table.bus, **table.processes[part.name].bus})
    return SandboxRules(
        mission.isolation.sandbox == "require", tuple(str(Path(path).absolute()) for path in read), talks
    )


def _files(options: Any) -> Iterator[str]:
    """Yield every text among options that names a file, such as a certificate."""
    if isinstance(options, dict):
        for each in options.values():
            yield from _files(each)
    elif isinstance(options, str) and Path(options).is_file():
        yield options
