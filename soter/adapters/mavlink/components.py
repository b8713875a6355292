"""Who is who on our side: the supervisor and the two controllers are components of one system."""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.sdk import Controller

KEEPER: Final[int] = mav.MAV_COMP_ID_MISSIONPLANNER
"""The supervisor: names who is in charge, renews the lease, asks for everything that is no target."""

SENDERS: Final = {
    Controller.AC: int(mav.MAV_COMP_ID_ONBOARD_COMPUTER),
    Controller.SC: int(mav.MAV_COMP_ID_ONBOARD_COMPUTER2),
}
"""From whom targets come."""

COMPONENTS: Final = (KEEPER, *SENDERS.values())

CONTROLLERS: Final = {component: controller for controller, component in SENDERS.items()}
