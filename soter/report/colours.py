"""The colours that pictures and pages share.

They can be told apart with every kind of colour blindness (after Okabe and Ito): warm and bright for the safety
modules, which matter most; cool and pale for the untrusted controllers.
"""

from __future__ import annotations

from typing import Final

MODULES: Final = {"collision": "#D55E00", "obstacle": "#A0348C", "geofence": "#E69F00", "battery": "#009E73"}
ROBOTS: Final = ("#1F6FB2", "#7C8088", "#56B4E9", "#2B3A67", "#7E6BC4", "#3E8E9E")
_OTHER_MODULES: Final = ("#8C1C13", "#5E4B00", "#3D2B56")


def driver_colour(name: str) -> str:
    """Return the colour of a safety module."""
    return MODULES.get(name) or _OTHER_MODULES[sum(map(ord, name)) % len(_OTHER_MODULES)]


def ac_colour(index: int) -> str:
    """Return the colour of a robot in AC; robots are counted from 0, in the order of their ids."""
    return ROBOTS[index % len(ROBOTS)]
