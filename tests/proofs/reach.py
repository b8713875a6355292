"""What the reach models that look at speed and heading promise, about the numbers that they themselves compute.

A bound covers every input, by induction, if it pays for coming to rest at once, and falls in any time by no less than
what the robot drives meanwhile (`speed_acceleration`). The bound of a unicycle is an integral. What is integrated is no
less, at any time, than what the robot may do then (`heading`, `turning`), and the integral grows by no less than that
(`integral`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import pi
from types import SimpleNamespace
from typing import Any, Final

import pytest
import z3

from soter.rta import DirectedReach, Motion, Situation, SpeedAccelerationBound, Threat, UnicycleBound
from soter.rta.models import motion
from tests.proofs.lemmas import Lemma
from tests.proofs.robots import Obligation
from tests.proofs.symbolic import Fact, SymbolicMath, branches, positive
from tests.rta.doubles import At

HALF_TURN: Final = z3.RealVal(pi)
RIGHT_ANGLE: Final = z3.RealVal(0.5 * pi)
"""What the code takes for them."""


def speed_acceleration(symbolic: SymbolicMath, patch: pytest.MonkeyPatch) -> Iterator[Obligation]:
    """However a robot drives for a while, what its model left of its way is no less than what the model then says."""
    (most, accel, brake), facts = positive("most accel brake")
    noise, seen, speed, later, time, passed = z3.Reals("noise seen speed later time passed")
    patch.setattr(motion, "hypot", lambda along, _: along)
    known = [
        noise >= 0, seen >= 0, speed >= 0, speed <= most, speed <= seen + noise, passed >= 0, passed <= time,
        later >= 0, later <= most, later <= speed + accel * passed,
    ]  # fmt: skip

    def extents() -> tuple[Any, Any, Any]:
        model = SpeedAccelerationBound(most, accel, brake, noise)
        exact = SpeedAccelerationBound(most, accel, brake, 0)
        far = model.extent(At(vx_m_s=seen), time, 1, 0)
        return far, exact.extent(At(vx_m_s=later), time - passed, 1, 0), model.bound(time)

    for branch in branches(extents, [*facts, *known], symbolic):
        far, left, bound = branch.value
        # The longest way from one speed to the other is that of a steady change, or one that is gone in parts.
        yield Obligation("what it drives is gone", far >= (speed + later) / 2 * passed + left, branch.facts)
        yield Obligation("it comes to rest", far * 2 * brake >= speed * speed, branch.facts)
        yield Obligation("no more than the bound", far <= bound, branch.facts)


def heading(symbolic: SymbolicMath, patch: pytest.MonkeyPatch) -> Iterator[Obligation]:
    """A unicycle is taken to be no slower, and to point no less along a direction, than it may really do."""
    (most, accel, brake, turn), facts = positive("most accel brake turn")
    reverse, speed, vx, vy, seen, true = z3.Reals("reverse speed vx vy seen true")
    noise, wrong, ux, uy, time = z3.Reals("noise wrong ux uy time")
    # The robot really points to the east: whoever looks may turn the frame.
    heading_rad, (cos, sin) = z3.Real("heading"), z3.Reals("cos sin")
    aligned, length = z3.Reals("aligned length")
    known = [
        wrong >= 0, wrong <= HALF_TURN, z3.Implies(wrong == 0, aligned == 1),
        z3.Implies(wrong < RIGHT_ANGLE, cos >= aligned),
        reverse >= 0, noise >= 0, -reverse <= speed, speed <= most, aligned > 0, aligned <= 1,
        # A reported velocity is wrong by `noise` at most: so are its length and its part along any unit vector.
        length + noise >= speed, length + noise >= -speed,
        vx * cos + vy * sin >= speed * cos - noise, vx * cos + vy * sin <= speed * cos + noise,
    ]  # fmt: skip
    # Of unit vectors; and the angles from the direction to both headings differ by no more than these do.
    unit = [cos * ux + sin * uy <= 1, cos * ux + sin * uy >= -1]
    angles = [true >= 0, true <= HALF_TURN, seen >= 0, seen <= HALF_TURN, seen - true <= wrong, true - seen <= wrong]
    cosines: list[Any] = []
    swept: list[tuple[Any, ...]] = []
    ways = z3.Reals("first second third")

    def integral(_: UnicycleBound, *asked: Any) -> Any:
        swept.append(asked)
        return ways[len(swept) - 1]

    def angle(cosine: Any) -> Any:
        cosines.append(cosine)
        return seen

    patch.setattr(motion, "cos", lambda of: cos if of is heading_rad else aligned)
    patch.setattr(motion, "sin", lambda _: sin)
    patch.setattr(motion, "acos", angle)
    patch.setattr(motion, "hypot", lambda *_: length)
    patch.setattr(UnicycleBound, "_swept", integral)

    def along() -> tuple[Any, list[tuple[Any, ...]], Any]:
        swept.clear()
        cosines.clear()
        model = UnicycleBound(most, accel, brake, turn, reverse, noise, wrong)
        sample = At(heading_rad=heading_rad, vx_m_s=vx, vy_m_s=vy)
        return model.extent(sample, time, ux, uy), [*swept], cosines[0]

    given = [*facts, *known, *unit, *angles, *(way > 0 for way in ways)]
    for branch in branches(along, given, symbolic):
        value, asked, cosine = branch.value
        ahead, behind, either = asked
        way = branch.facts[len(given) :]
        # Each from as little as it needs: Z3 is quicker so.
        yield Obligation("the angle is the heading's", cosine == cos * ux + sin * uy, unit)
        points = z3.And(ahead[2] <= true, behind[2] <= HALF_TURN - true)
        yield Obligation("it points no less along it", points, [*angles, *way])
        yield Obligation("forwards", z3.And(ahead[0] >= speed, ahead[1] >= most), [*facts, *known, *way])
        yield Obligation("backwards", z3.And(behind[0] >= -speed, behind[1] >= reverse), [*facts, *known, *way])
        no_less = [z3.And(either[0] >= each[0], either[1] >= each[1], either[2] <= each[2]) for each in (ahead, behind)]
        yield Obligation("whichever end is nearer", z3.And(*no_less), [])
        yield Obligation("the lesser of both", z3.Or(value >= ways[0] + ways[1], value >= ways[2]), [])


def turning(symbolic: SymbolicMath, patch: pytest.MonkeyPatch) -> Iterator[Obligation]:
    """At every time what is integrated is no less than what a robot does that turns and speeds up as fast as it may."""
    (most, accel, brake, turn), facts = positive("most accel brake turn")
    speed, angle, period, time, at, way = z3.Reals("speed angle period time at way")
    fast, points, last, cosine = z3.Reals("fast points last cosine")
    pieces: list[tuple[Any, ...]] = []
    turned: list[Any] = []

    def cos(of: Any) -> Any:
        turned.append(of)
        return cosine

    patch.setattr(motion, "cos", cos)
    patch.setattr(motion, "way_m", lambda *_: way)
    model: Any = SimpleNamespace(accel_m_s2=accel, yaw_rate_max_rad_s=turn, period_s=period)

    def piece(*asked: Any) -> int:
        pieces.append(asked)
        return 0

    model._piece = piece
    # At `at` it drives so fast, `points` off the direction; `last` is how fast it is when it is told to stop.
    driven = z3.And(at <= time, fast <= speed + accel * at, points >= angle - turn * at)
    braked = z3.And(at > time, fast <= last - brake * (at - time), points >= angle - turn * (at + period))
    known = [
        speed >= 0, angle >= 0, angle <= HALF_TURN, period >= 0, time >= 0, at >= 0, fast >= 0, fast <= most,
        points >= 0, points <= HALF_TURN, last >= 0, last <= most, last <= speed + accel * time, z3.Or(driven, braked),
        cosine >= 0, way >= 0,
    ]  # fmt: skip

    def integral() -> tuple[Any, list[tuple[Any, ...]], list[Any]]:
        pieces.clear()
        turned.clear()
        return UnicycleBound._swept(model, speed, most, angle, time, brake), [*pieces], [*turned]

    for branch in branches(integral, [*facts, *known], symbolic):
        value, asked, cosines = branch.value
        idle = z3.Or(fast <= 0, points >= RIGHT_ANGLE)
        if asked:
            covered = [
                z3.And(begin <= at, at <= end, first + slope * (at - begin) >= fast, from_rad - turn * at <= points)
                for first, slope, from_rad, begin, end in asked
            ]
            yield Obligation("what it does is counted", z3.Or(idle, *covered), branch.facts)
        elif not z3.is_expr(value):
            yield Obligation("it never gets along", idle, branch.facts)
        else:
            # All of the way, and of coming to rest, counts as driven at the end of the turn.
            share = cosine if cosines else 1
            whole = 2 * brake * value >= (2 * brake * way + last * last) * share
            told = z3.And(whole, *(of <= points for of in cosines))
            yield Obligation("a slow turn is done at once", z3.Or(idle, told), branch.facts)


@dataclass(frozen=True)
class _Rate:
    """A number and how fast it grows while the end of an integral moves on: what the code makes of it is derived."""

    value: Any
    rate: Any = 0

    @staticmethod
    def of(number: Any) -> _Rate:
        return number if isinstance(number, _Rate) else _Rate(number)

    def __add__(self, other: Any) -> _Rate:
        other = _Rate.of(other)
        return _Rate(self.value + other.value, self.rate + other.rate)

    def __sub__(self, other: Any) -> _Rate:
        return self + -1 * _Rate.of(other)

    def __mul__(self, other: Any) -> _Rate:
        other = _Rate.of(other)
        return _Rate(self.value * other.value, self.value * other.rate + self.rate * other.value)

    __radd__, __rmul__ = __add__, __mul__

    def __truediv__(self, other: Any) -> _Rate:
        # Whatever the code divides by stands still.
        return _Rate(self.value / other.value, self.rate / other.value)

    def __lt__(self, other: Any) -> Any:
        return self.value < _Rate.of(other).value

    def __gt__(self, other: Any) -> Any:
        return self.value > _Rate.of(other).value

    def __ge__(self, other: Any) -> Any:
        return self.value >= _Rate.of(other).value

    def __ne__(self, other: object) -> Any:
        return self.value != _Rate.of(other).value


def integral(symbolic: SymbolicMath, patch: pytest.MonkeyPatch) -> Iterator[Obligation]:
    """A piece grows with its end by the speed that is reached there, times the alignment, and by no less."""
    (turn,), facts = positive("turn")
    speed, slope, angle, start, end = z3.Reals("speed slope angle start end")
    patch.setattr(motion, "min", min)
    sines: list[tuple[Any, Any, Any]] = []

    def turned(of: _Rate) -> tuple[Any, Any]:
        angle = z3.simplify(of.value)
        for known, cos, sin in sines:
            if known.eq(angle):
                return cos, sin
        cos, sin = z3.Reals(f"cos_{len(sines)} sin_{len(sines)}")
        sines.append((angle, cos, sin))
        return cos, sin

    patch.setattr(motion, "cos", lambda of: _Rate(turned(of)[0], -turned(of)[1] * of.rate))
    patch.setattr(motion, "sin", lambda of: _Rate(turned(of)[1], turned(of)[0] * of.rate))
    model: Any = SimpleNamespace(yaw_rate_max_rad_s=_Rate(turn))
    cos, _ = turned(_Rate(angle - turn * end))
    known = [angle >= 0, angle <= HALF_TURN, start >= 0, start < end, speed + slope * (end - start) >= 0]

    def piece() -> Any:
        numbers: tuple[Any, ...] = (*(_Rate(each) for each in (speed, slope, angle, start)), _Rate(end, 1))
        return _Rate.of(UnicycleBound._piece(model, *numbers)).rate

    for branch in branches(piece, [*facts, *known], symbolic):
        off, reached = angle - turn * end, speed + slope * (end - start)
        yield Obligation("beside it", z3.Implies(off > RIGHT_ANGLE, branch.value >= 0), branch.facts)
        turns = z3.And(off > 0, off < RIGHT_ANGLE)
        yield Obligation("while it turns", z3.Implies(turns, branch.value >= reached * cos), branch.facts)
        yield Obligation("along it", z3.Implies(off < 0, branch.value >= reached), branch.facts)


class _Tube(Motion):
    """A motion of which only the top speed is known, and that each of its extents is no more than its bound."""

    def __init__(self, name: str, facts: list[Fact]) -> None:
        (self.most, self.stop), known = positive(f"most_{name} stop_{name}")
        self._name, self._facts = name, facts
        facts += known

    def bound(self, time_s: Any) -> Any:
        return self.most * time_s + self.stop

    def extent(self, sample: Any, time_s: Any, ux: Any, uy: Any, uz: Any = 0) -> Any:
        found = z3.Real(f"{self._name} of {sample.robot_id} within {z3.simplify(time_s)} towards {ux} {uy}")
        self._facts += [found >= 0, found <= self.bound(time_s)]
        return found

    def admits(self, before: Any, after: Any, noise_m: float) -> bool:
        raise NotImplementedError


def pairs(symbolic: SymbolicMath, patch: pytest.MonkeyPatch) -> Iterator[Obligation]:
    """No pair's margin falls by more than a directed reach says, and half of the gap is this robot's way at least."""
    facts = symbolic.facts
    own, other = _Tube("own", facts), _Tube("other", facts)
    time, first, second, margin, old = z3.Reals("time first second margin old")
    # One peer to the east, one to the north, heard of `old` before the robot itself, or after it.
    peers = [At(robot_id=2, stamp_s=-old), At(robot_id=3, stamp_s=-old)]
    threats = [Threat(first, 1, 0, 0, peers[0]), Threat(second, 0, 1, 0, peers[1])]
    region: Any = SimpleNamespace(margin=lambda _: margin, threats=lambda _: threats)
    look = Situation(1, At(), 0)
    given = [time >= 0, z3.Or(margin == first, margin == second), margin <= first, margin <= second]

    for branch in branches(lambda: DirectedReach(region, own, other).reach(look, time), given, symbolic):
        left = margin - branch.value
        for part, ux, uy, _, peer in threats:
            # A margin counts a peer that was heard of before as driving at top speed since then.
            since = z3.If(old > 0, old, 0)
            within = time + old
            theirs = z3.If(old > 0, other.extent(peer, within, -ux, -uy), other.extent(peer, time, -ux, -uy))
            drives = own.extent(look.own, time, ux, uy)
            yield Obligation("the margin", left <= part - drives - (theirs - other.most * since), branch.facts)
            yield Obligation("half of the gap", left <= part - 2 * drives, branch.facts)


LEMMAS: Final[dict[str, Lemma]] = {
    each.__name__: each for each in (speed_acceleration, heading, turning, integral, pairs)
}
