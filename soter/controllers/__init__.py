"""Advanced controllers in place of a mission's machines: users' own, and adversaries. All are untrusted."""

from soter.controllers.base import Arena, Controller
from soter.controllers.names import (
    ADVERSARIES,
    MISSION,
    PREFIX,
    build,
    controller_class,
    options_of,
    refuse_unknown_tables,
)
from soter.controllers.tracking import VelocityTracker
from soter.controllers.velocity import VelocityController
from soter.onboard.velocity import Velocity

__all__ = [
    "ADVERSARIES",
    "MISSION",
    "PREFIX",
    "Arena",
    "Controller",
    "Velocity",
    "VelocityController",
    "VelocityTracker",
    "build",
    "controller_class",
    "options_of",
    "refuse_unknown_tables",
]
