"""Options of the backend `zenoh`, given in `[backends.zenoh]` of a mission file."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Annotated, Final

from pydantic import Field, ValidationInfo, field_validator

from soter.adapters.velocity_controlled.options import MessageNames, PlaceOptions, VelocityControlledConfig
from soter.adapters.zenoh.session import SessionOptions
from soter.onboard.gate_node import PERIOD_S
from soter.problems import not_allowed
from soter.sdk import Capabilities

_KEY: Final = re.compile(r"[^/*$?#\s]+(/[^/*$?#\s]+)*")

CLOCK: Final = "clock"
"""The key of a simulated robot's clock, in its namespace; `/clock` in ROS."""

Positive = Annotated[float, Field(gt=0.0, le=1e6, allow_inf_nan=False)]


def check_key(key: str) -> None:
    """Check that a text is a key, and no pattern.

    Raises:
        ValueError: the text begins or ends with a slash, or is a pattern.
    """
    if not _KEY.fullmatch(key):
        raise not_allowed("a key such as robot1/odom, without a slash at either end and without * $ ? #")


class Keys(MessageNames):
    """The keys of a robot's messages, below its namespace; with a leading slash, which is dropped, full keys.

    These are the names of the ROS topics, as zenoh-bridge-ros2dds maps them.
    """

    check = staticmethod(lambda name: check_key(name.removeprefix("/")))

    def of(self, namespace: str) -> Keys:
        """Return the keys of one robot, in full."""
        given = self.model_dump().items()
        full = {name: key[1:] if key.startswith("/") else key and f"{namespace}/{key}" for name, key in given}
        return Keys.model_validate(full)


class ZenohRobotOptions(PlaceOptions):
    """The place of one robot; its namespace is the beginning of its keys, such as robot1."""

    check = staticmethod(check_key)


class ZenohConfig(VelocityControlledConfig):
    """Options of the backend `zenoh`, besides those of `VelocityControlledConfig`.

    Attributes:
        robots: by number, the places of the robots; if empty, simulated robots are started.
        keys: the keys of their messages.
        session: options of the Zenoh session.
        speedup: robot seconds per host second; for simulated robots only.
    """

    robots: dict[int, ZenohRobotOptions] = Field(default_factory=dict)
    keys: Keys = Keys()
    session: SessionOptions = SessionOptions()
    speedup: Positive = 1.0

    @field_validator("session")
    @classmethod
    def _leads_to_robots(cls, session: SessionOptions, info: ValidationInfo) -> SessionOptions:
        if session.connect and not info.data.get("robots", True):
            raise not_allowed("connect only with robots to reach, a table [backends.zenoh.robots.N] for each")
        return session

    def promised(self) -> Capabilities:
        """Return the robots' promise; times are in fleet time, `speedup` seconds of which pass in a host second."""
        declared, speedup = super().promised(), self.speedup
        return replace(
            declared,
            latency_s=declared.latency_s * speedup,
            sample_age_s=declared.sample_age_s * speedup,
            jitter_s=declared.jitter_s * speedup,
            lease_s=declared.lease_s + PERIOD_S * (speedup - 1.0),
            position_noise_m=declared.position_noise_m * speedup,
        )
