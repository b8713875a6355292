"""DDS on this host only, for robots that are simulated here: nothing is heard or said beyond 127.0.0.1."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Final

_PROFILE: Final = Path(__file__).with_name("loopback.xml")

SETTINGS: Final[Mapping[str, str]] = {
    "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
    "FASTRTPS_DEFAULT_PROFILES_FILE": str(_PROFILE),
    "FASTDDS_DEFAULT_PROFILES_FILE": str(_PROFILE),
    # ROS would otherwise add peers and interfaces of its own.
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",
}
"""What keeps ROS 2 programs on this host, in their environment; `ROS_LOCALHOST_ONLY` must not be set."""

# Deprecated, and with it every interface is bound all the same.
_UNSET: Final = "ROS_LOCALHOST_ONLY"


def environment() -> dict[str, str]:
    """Return the environment of a program whose participants are to stay on this host."""
    return {name: value for name, value in os.environ.items() if name != _UNSET} | {**SETTINGS}


@contextmanager
def loopback() -> Iterator[None]:
    """Keep participants that are made meanwhile in this process on this host.

    Fast DDS reads the profile when the first participant of a process is made: one that has spoken to the network
    before goes on doing so.
    """
    before = {name: os.environ.get(name) for name in (*SETTINGS, _UNSET)}
    os.environ.update(SETTINGS)
    os.environ.pop(_UNSET, None)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
