"""The words of a picture. Whoever has the figures of a run phrases them; a picture only sets them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Caption:
    """What stands above and beside the picture of a run.

    Attributes:
        title: what was run.
        figures: the few numbers that matter most, each a few words.
        alarming: whether the figures are bad news, and set as such.
        disengagements: by safety module; empty where they were not counted.
        details: what else it takes to run it again.
    """

    title: str = ""
    figures: tuple[str, ...] = ()
    alarming: bool = False
    disengagements: Mapping[str, int] = field(default_factory=dict)
    details: str = ""
