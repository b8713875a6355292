"""Under which conditions two robots may each use up half of the gap between them, and that missions are held to it."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any, cast

import pytest

from soter.errors import IllFormedModule
from soter.rta import PairBound, RTAModule, SpeedBound
from soter.stack.collision import Separation, check_halves
from tests.rta.doubles import FakeNode


def module(delta_s: float = 0.1, least_m: float = 0.3, brake_m_s2: float = 1.0) -> RTAModule:
    node, speed = FakeNode("node"), SpeedBound(0.22, brake_m_s2)
    return RTAModule(
        "collision", node, node, delta_s, Separation(least_m, 0.22), Separation(least_m + 0.2, 0.22),
        PairBound(speed, speed),
    )  # fmt: skip


def suggested(error: IllFormedModule) -> float:
    found = re.search(r"(?:phi_safe_m|; Delta) = ([\d.]+)", str(error))
    assert found is not None
    return float(found[1])


def test_legs_are_at_most_a_quarter_of_the_separation() -> None:
    check_halves(module(), 0.075)
    with pytest.raises(IllFormedModule, match=r"P2a.*up to 0\.080 m long.*separation of 0\.3 m") as caught:
        check_halves(module(), 0.0801)
    check_halves(module(least_m=suggested(caught.value)), 0.0801)


def test_braking_takes_at_most_four_delta() -> None:
    check_halves(module(brake_m_s2=0.55), 0.05)
    with pytest.raises(IllFormedModule, match=r"P2a.*takes 0\.440 s.*4 Delta = 0\.4 s") as caught:
        check_halves(module(brake_m_s2=0.5), 0.05)
    check_halves(module(suggested(caught.value), brake_m_s2=0.5), 0.05)


def test_a_rule_of_another_kind_has_no_halves() -> None:
    check_halves(replace(module(), model=SpeedBound(0.22, 1.0)), 10.0)
    check_halves(replace(module(), phi_safe=cast("Any", None), model=None), 10.0)
