"""A module that is wrong: it looks one Delta ahead where two have to be looked at. `soter check` finds out."""

from soter import ModuleKit
from soter.rta import Node, RTAModule, Situation
from soter.sdk import Waypoint
from soter.stack.static_rules import Fence

DELTA_S = 0.5
ROOM = Fence(1.0, 5.0, 1.0, 5.0)


class ToTheMiddle(Node):
    """Drives to the middle of the room."""

    name, publishes = "to-the-middle", ("waypoint",)

    def __init__(self, kit: ModuleKit) -> None:
        self.waypoint, self.period_s = kit.waypoint, kit.tick_s

    def step(self, situation: Situation) -> None:
        self.waypoint.publish(Waypoint(3.0, 3.0))


def declare(kit: ModuleKit) -> RTAModule:
    """Declare the module by predicates, which nobody can check but by trying."""
    v_max_m_s = kit.capabilities.v_max_m_s

    def soon(situation: Situation) -> bool:
        return ROOM.margin(situation) < v_max_m_s * DELTA_S

    def safer(situation: Situation) -> bool:
        return ROOM.margin(situation) >= 0.5

    return RTAModule(kit.name, kit.ac, ToTheMiddle(kit), DELTA_S, ROOM, safer, ttf_2delta=soon)
