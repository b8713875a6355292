"""The inequalities of docs/assurance.md, about the numbers that the code itself computes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any, Final

import pytest
import z3

from soter.errors import IllFormedModule
from soter.rta import DischargeBound, Situation
from soter.stack import recovery, site_terrain, terrain
from soter.stack.battery import ChargeForTheWayHome
from soter.stack.collision import check_halves
from soter.stack.modules import obstacle
from soter.stack.recovery import RecoveryPlanner
from soter.stack.return_path import ReturnPath, _Anchor
from soter.stack.static_rules import Clearance
from soter.stack.terrain import Terrain
from tests.proofs.robots import Gap, Line, Obligation, Robot
from tests.proofs.symbolic import FAR_M, Fact, SymbolicMath, branches, holds, positive
from tests.rta.doubles import At

Lemma = Callable[[SymbolicMath, pytest.MonkeyPatch], Iterator[Obligation]]


def lemma_1(symbolic: SymbolicMath, patch: pytest.MonkeyPatch) -> Iterator[Obligation]:
    """A look that leaves the AC in control is enough until the next one, and then for stopping."""
    robot = Robot()
    seen, keep = z3.Reals("seen keep")
    module = robot.module(Line(seen), Line(seen), keep=keep)
    promised = [*robot.facts, keep >= 0]
    for branch in branches(lambda: robot.decision(module)._in_danger(robot.situation()), promised, symbolic):
        # What the sample was worth when it was taken.
        margin = seen - robot.noise
        given = [*branch.facts, z3.Not(holds(branch.value))]
        told = margin - robot.v * (robot.a + robot.delta + robot.J + robot.L) - robot.stop_m
        unused = robot.v * robot.delta
        yield Obligation("(i) told to stop at the next look", told >= unused + keep, given)
        moves_on_s = robot.a + robot.delta - robot.tau + robot.J + robot.L + robot.lease
        dead = margin - robot.v * moves_on_s - robot.stop_m
        yield Obligation("(ii) the supervisor dies", dead >= 0, given)
        # Lemma 2: another module fires, Delta + J after this one's look at the latest.
        fired = margin - robot.v * (robot.a + robot.delta + robot.J)
        yield Obligation("Lemma 2", fired >= robot.v * (robot.delta + robot.L) + robot.stop_m, given)


def kept_for_paths(symbolic: SymbolicMath, patch: pytest.MonkeyPatch) -> Iterator[Obligation]:
    """A robot that the obstacle module, or another one, has stopped is where paths fit."""
    robot, seen = Robot(), z3.Real("seen")
    table: Any = SimpleNamespace(delta_s=robot.delta, model="speed")

    def look() -> Any:
        planner = robot.recovery()
        keep = obstacle.keep_m(table, planner, robot.timing)
        fires = robot.decision(robot.module(Line(seen), Line(seen), keep=keep))._in_danger(robot.situation())
        return fires, planner.path_m

    for branch in branches(look, robot.facts, symbolic):
        fires, path_m = branch.value
        rest = seen - robot.noise - robot.v * (robot.a + robot.delta + robot.J + robot.L) - robot.stop_m
        given = [*branch.facts, z3.Not(holds(fires))]
        yield Obligation("where it stands paths fit", rest >= path_m, given)


def beside_one_box(symbolic: SymbolicMath, patch: pytest.MonkeyPatch) -> Iterator[Obligation]:
    """Beside one box in the open the robot drives straight away from that, and is where paths fit all the way."""
    (fence, near, far, path, fall), facts = positive("fence near far path fall")
    ground: Any = SimpleNamespace(
        fence_m=lambda *_: fence, clearance_m=lambda *_: near, inside=lambda *_: (0, 0),
        walls=lambda *_: [(near, 1, 0), (far, 0, 1)], convex=True,
    )  # fmt: skip
    region = Clearance(ground, 0, path, fenced=True)
    look = Situation(1, At(), 0.0)
    keep = z3.Real("keep")
    for branch in branches(lambda: region.leaves_room(look, near, keep, fall), [*facts, far >= near], symbolic):
        beyond = z3.Or(near - fall >= keep, z3.And(far - fall - path >= path, fence - fall - path >= path))
        yield Obligation("room for a path beside it", z3.Implies(holds(branch.value), beyond), branch.facts)


def p3(symbolic: SymbolicMath, patch: pytest.MonkeyPatch) -> Iterator[Obligation]:
    """Where P3 holds, phi_safer is enough for giving back, and whatever gives back satisfies the premise of Lemma 1."""
    robot = Robot()
    (seen, least, keep), facts = positive("seen least keep")
    module = robot.module(Line(seen), Line(seen, least), keep=keep)
    given = [*robot.facts, *facts]

    def judged() -> Any:
        assert module.phi_safe is not None
        assert module.model is not None
        module._check_reach(module.phi_safe, module.model, robot.timing, robot.tau)
        decision = robot.decision(module)
        return decision._in_danger(robot.situation()), decision._fit_for_ac(robot.situation())

    for branch in branches(judged, given, symbolic, IllFormedModule):
        if branch.value is None:
            continue
        danger, back = map(holds, branch.value)
        yield Obligation("phi_safer is no danger", z3.Implies(seen >= least, z3.Not(danger)), branch.facts)
        # Noise and age may have made it look better.
        inside = seen - least - robot.noise - robot.v * robot.a >= 0
        yield Obligation("phi_safer gives back", z3.Implies(inside, back), branch.facts)
        yield Obligation("nothing else does", z3.Implies(back, z3.Not(danger)), branch.facts)


# --- legs -------------------------------------------------------------------------------------------------


def legs(symbolic: SymbolicMath, patch: pytest.MonkeyPatch) -> Iterator[Obligation]:
    """A leg holds what the robot drives before its next command acts, and stopping; and it is never too short to go."""
    robot = Robot()
    for branch in branches(lambda: robot.recovery().leg_m(robot.a), robot.facts, symbolic):
        driven = robot.v * (robot.tau + robot.L + robot.a) + robot.stop_m
        yield Obligation("stopping ends inside the leg", branch.value >= driven, branch.facts)
        yield Obligation("half of it is no arrival yet", branch.value / 2 >= recovery._ARRIVED_M, branch.facts)


def paths(symbolic: SymbolicMath, patch: pytest.MonkeyPatch) -> Iterator[Obligation]:
    """Every leg of a path is certified, from wherever the robot is by then and is seen."""
    robot = Robot()
    beside, off, wrong = z3.Reals("corner off wrong")
    given = [*robot.facts, beside <= recovery.CORNER_M, off <= robot.tube, wrong <= robot.noise]
    for branch in branches(robot.recovery, given, symbolic):
        planner = branch.value
        assert planner is not None
        there = planner.path_m - beside - off - wrong
        drift = robot.v * math.sin(0.35) * robot.a
        yield Obligation("its clearance suffices", there >= robot.tube + robot.noise + drift, branch.facts)


def lead_away(sin: Any) -> Any:
    """Return how much a leg that leads away rises, a metre, at least: the sine of the cone that robots keep to."""
    return sin


def _cone(patch: pytest.MonkeyPatch, ex: Any, ey: Any) -> tuple[Any, Any, Any, list[Fact]]:
    """Return sine of the cone and a displacement (u) anywhere within the cone around a leg in the direction e."""
    (cos, sin, far), facts = positive("cos sin far")
    ux, uy = z3.Reals("ux uy")
    patch.setattr(recovery, "_ALIGNED_SIN", lead_away(sin))
    facts += [cos * cos + sin * sin == 1, ex * ex + ey * ey == 1]
    return lead_away(sin), ux, uy, [*facts, far * far == ux * ux + uy * uy, ux * ex + uy * ey >= cos * far]


def lemma_3_boxes(symbolic: SymbolicMath, patch: pytest.MonkeyPatch) -> Iterator[Obligation]:
    """A leg from where the tracking error does not fit beside a box leads away from it, however the robot strays."""
    ex, ey, past = z3.Reals("ex ey past")
    (needed, near, length), facts = positive("needed near length")
    slope, ux, _, cone = _cone(patch, ex, ey)
    patch.setattr(terrain, "segment_to_box", lambda *_: past)
    patch.setattr(symbolic, "hypot", lambda *_: length)
    # One box, to the east: whoever looks may turn the frame. How near the leg passes is anybody's guess.
    one: Any = SimpleNamespace(body_radius_m=0, walls=lambda *_: [(near, 1, 0)], _edges=(None,))
    given = [*facts, *cone, near < FAR_M / 2, past < FAR_M / 2]
    leg = (0, 0, length * ex, length * ey, needed, slope)
    for branch in branches(lambda: Terrain.leg_clearance_m(one, *leg), given, symbolic):
        # From a convex body the distance grows by no less than its slope at the start says.
        kept = z3.Or(z3.And(near >= needed, past >= needed), -ux >= 0)
        yield Obligation("away from a box", z3.Implies(branch.value >= needed, kept), branch.facts)


def lemma_3_pieces(symbolic: SymbolicMath, patch: pytest.MonkeyPatch) -> Iterator[Obligation]:
    """The same beside a convex piece of what is kept out of, or of what is outside of a fence."""
    ex, ey, past = z3.Reals("ex ey past")
    (needed, near, length), facts = positive("needed near length")
    slope, ux, _, cone = _cone(patch, ex, ey)
    patch.setattr(symbolic, "hypot", lambda *_: length)
    patch.setattr(symbolic, "dist", lambda *_: 0, raising=False)
    piece: Any = SimpleNamespace(middle=(0, 0), radius_m=0, wall=lambda *_: (near, 1, 0), segment_m=lambda *_: past)
    pieces: Any = SimpleNamespace(within=lambda *_: [piece])
    given = [*facts, *cone, near < FAR_M / 2, past < FAR_M / 2]
    leg = ((0, 0), (length * ex, length * ey), needed, slope)
    for branch in branches(lambda: site_terrain._leg_m(pieces, *leg), given, symbolic):
        kept = z3.Or(z3.And(near >= needed, past >= needed), -ux >= 0)
        yield Obligation("away from a piece", z3.Implies(branch.value >= needed, kept), branch.facts)


def lemma_3_fence(symbolic: SymbolicMath, patch: pytest.MonkeyPatch) -> Iterator[Obligation]:
    """The same beside two sides of the fence; the others are alike."""
    ex, ey, ax, ay = z3.Reals("ex ey ax ay")
    (width, tube, length), facts = positive("width tube length")
    slope, ux, uy, cone = _cone(patch, ex, ey)
    bx, by = ax + length * ex, ay + length * ey
    patch.setattr(symbolic, "hypot", lambda *_: length)
    ground: Any = SimpleNamespace(width_m=width, depth_m=width)
    ground.fence_m = lambda x, y: Terrain.fence_m(ground, x, y)
    far = [width - each > tube + length for each in (ax, ay, bx, by)]
    leg = (ax, ay, bx, by, tube, slope)
    for branch in branches(lambda: Terrain.leg_fence_m(ground, *leg), [*facts, *cone, *far], symbolic):
        for name, start, end, rises in (("west", ax, bx, ux), ("south", ay, by, uy)):
            kept = z3.Or(z3.And(start >= tube, end >= tube), rises >= 0)
            yield Obligation(f"away from the fence, {name}", z3.Implies(branch.value >= 0, kept), branch.facts)


# --- pairs ------------------------------------------------------------------------------------------------


def _pair() -> tuple[Robot, Robot, Any, list[Fact]]:
    """Return a robot, the worst of its peers, the separation, and what is known of them."""
    own, peer, separation = Robot(), Robot("_p"), z3.Real("separation")
    return own, peer, separation, [*own.facts, *peer.facts, separation > 0, peer.v >= own.v, peer.b <= own.b]


def lemma_4_ac(symbolic: SymbolicMath, patch: pytest.MonkeyPatch) -> Iterator[Obligation]:
    """A robot that is left to its AC has at most half of the gap until the next look, however it drives."""
    own, peer, separation, given = _pair()
    seen = z3.Real("seen")
    region = Gap(separation, peer.v, peer.noise, seen)
    module = own.module(region, region, peer)
    for branch in branches(lambda: own.decision(module)._in_danger(own.situation()), given, symbolic):
        gap = seen - own.noise - peer.noise
        extent = own.v * (own.a + own.delta + own.J + own.L) + own.stop_m
        early = own.v * own.delta
        kept = [*branch.facts, z3.Not(holds(branch.value)), peer.stop_m >= own.stop_m]
        yield Obligation("half of the gap", 2 * (extent + early) <= gap, kept)
    yield Obligation("the peer stops no sooner", peer.stop_m >= own.stop_m, given)


class _Legs:
    """A leg of a certain length in the direction (ex, ey), and a peer to the east, in a symbolic plane."""

    def __init__(self, symbolic: SymbolicMath, patch: pytest.MonkeyPatch) -> None:
        self.own, self.peer, self.separation, given = _pair()
        (self.apart, self.old, self.length), facts = positive("apart old length")
        self.ex, self.ey = z3.Reals("ex ey")
        _, self.ux, _, cone = _cone(patch, self.ex, self.ey)
        self.facts = [*given, *facts, *cone, self.old <= self.own.A, self.apart < FAR_M / 2]
        self.look = self.own.situation(At(self.apart, 0, -self.old))
        self.dx, self.dy = self.length * self.ex, self.length * self.ey
        squares = (self.dx * self.dx + self.dy * self.dy, self.length), (self.apart * self.apart, self.apart)
        self._known = [(z3.simplify(square), root) for square, root in squares]
        patch.setattr(symbolic, "sqrt", self._root)

    def planner(self) -> RecoveryPlanner:
        """Return what certifies the leg."""
        return self.own.recovery(self.separation, self.peer)

    def _root(self, square: Any) -> Any:
        """Return the root of a square of which it is known: of both lengths, else of the leg's part across the line."""
        square = z3.simplify(square)
        known = next((root for each, root in self._known if each.eq(square)), None)
        return self.length * z3.If(self.ey >= 0, self.ey, -self.ey) if known is None else known


def lemma_4_sc(symbolic: SymbolicMath, patch: pytest.MonkeyPatch) -> Iterator[Obligation]:
    """Whatever a robot reaches on a certified leg is within its half, less what the peer may take of that meanwhile."""
    legs = _Legs(symbolic, patch)
    own, peer = legs.own, legs.peer
    along, across = z3.Reals("along across")
    strays = [along >= 0, along <= legs.length, across <= own.tube, across >= -own.tube]
    ages, noise = own.a + legs.old, own.noise + peer.noise
    for branch in branches(lambda: legs.planner()._pair_spare_m(legs.look, legs.dx, legs.dy), legs.facts, symbolic):
        spare = branch.value
        if spare is symbolic.inf:
            both = sum(one.v * (own.tau + one.L + one.A) + one.stop_m + one.tube for one in (own, peer))
            left = legs.apart - noise - peer.v * ages - legs.separation
            yield Obligation("too far for two legs", both <= left, branch.facts)
            continue
        given = [*branch.facts, *strays, spare >= 0]
        half = (legs.apart - noise - legs.separation) / 2 - peer.v * (own.tau + own.L + ages)
        # Across a leg that leads aside the robot may only stray to the side; of one that leads away, not at all: u.
        aside = along * legs.ex - across * legs.ey
        yield Obligation("beside the leg", z3.Or(aside <= half, legs.ux <= 0), given)
        # Towards the peer it may run beyond the end.
        yield Obligation("beyond its end", z3.Implies(legs.ex > 0, along * legs.ex + across <= half), given)


def lemma_4_hand_over(symbolic: SymbolicMath, patch: pytest.MonkeyPatch) -> Iterator[Obligation]:
    """What a robot that brakes takes of the other half, and what the line turns by, its peer has set aside."""
    own, peer, separation, given = _pair()
    (leg, speed, apart), facts = positive("leg speed apart")
    region = Gap(separation, peer.v, peer.noise, 0)
    module = own.module(region, region, peer)

    def passes() -> None:
        check_halves(module, own.timing, leg, peer.L)

    promised = [*given, *facts, speed <= own.v, apart >= separation]
    for branch in branches(passes, promised, symbolic, IllFormedModule):
        if branch.refusal is not None:
            continue
        blind_m = peer.v * (own.tau + own.L)
        yield Obligation("the line turns", leg * 2 * blind_m <= apart * blind_m / 2, branch.facts)
        ahead = own.timing.ahead_s(own.delta)
        # It brakes from `speed`, for speed / b, while its peer comes nearer; all of it times b, as Z3 minds quotients.
        taken = (peer.v * speed - speed * speed / 2) / 2 - own.b * speed * (ahead - own.delta)
        room = own.b * (peer.v - own.v) * (ahead + own.L + own.J + own.a) / 2
        aside = own.b * peer.v * (own.tau + peer.L) / 2
        yield Obligation("it brakes", taken - room <= aside, branch.facts)


def apart_m(symbolic: SymbolicMath, patch: pytest.MonkeyPatch) -> Iterator[Obligation]:
    """Beside a robot at rest that is as far away a leg is certified whatever its direction, a short one at least."""
    legs = _Legs(symbolic, patch)

    def certified() -> Any:
        planner = legs.planner()
        spare = planner._pair_spare_m(legs.look, legs.dx, legs.dy)
        return spare, planner.apart_m(legs.own.A)

    for branch in branches(certified, legs.facts, symbolic):
        spare, needed = branch.value
        # The shortest leg that is driven at all.
        short = [legs.apart >= needed, legs.length <= recovery._ARRIVED_M]
        yield Obligation("a leg is certified", spare >= 0, [*branch.facts, *short])


# --- the return path --------------------------------------------------------------------------------------


def _place(name: str) -> tuple[Any, Any]:
    x, y = z3.Reals(f"{name}_x {name}_y")
    return x, y


def return_path(symbolic: SymbolicMath, patch: pytest.MonkeyPatch) -> Iterator[Obligation]:
    """The path's accounted length grows by what the robot drives, and two `path_m`, when it is found anew."""
    robot = Robot()
    (length, radius, cost, drive, time, path_m), facts = positive("length radius cost drive time path_m")
    short, clear, fence, charge, used = z3.Reals("short clear fence charge used")
    here, before, entry = (_place(name) for name in ("here", "before", "entry"))
    anchor = _Anchor(_place("anchor"), length, radius, None, None)
    path = object.__new__(ReturnPath)
    way = SimpleNamespace(distance_m=lambda *_: short)
    for name, value in {
        "entry": lambda *_: entry, "roomy": way, "narrow": way, "_last": before, "_cap_m": 1, "_boxes_m": path_m,
        "_fence_m": path_m, "_recovery": SimpleNamespace(free=lambda *_: True),
        "_terrain": SimpleNamespace(clearance_m=lambda *_: clear, fence_m=lambda *_: fence, convex=True),
    }.items():  # fmt: skip
        path.__dict__[name] = value
    region = ChargeForTheWayHome(SimpleNamespace(path=path, cost_per_m=cost))  # type: ignore[arg-type]
    model = DischargeBound(drive, robot.v, cost, JUMPS * path_m * cost)

    def margins() -> Any:
        path._anchor = anchor
        was = region.margin(Situation(1, At(*before, battery=charge), 0.0))
        path.track(*here)
        found = path._anchor
        assert found is not None
        now = region.margin(Situation(1, At(*here, battery=charge - used), 0.0))
        driven = None if found is anchor or found.routes is None else short
        return was, now, path.length_m(*here), driven

    moved, beside = symbolic.dist(before, here), symbolic.dist(here, entry)
    seen = symbolic.dist(before, anchor.place) <= radius
    given = [
        *robot.facts, *facts, moved <= robot.v * time, beside <= path_m, used <= drive * time, seen, short >= 0,
        short <= FAR_M,
    ]  # fmt: skip
    for branch in branches(margins, given, symbolic):
        was, now, accounted, driven = branch.value
        yield Obligation("the battery's reach bound", was - now <= model.bound(time), branch.facts)
        if driven is not None:
            yield Obligation("what is driven is accounted for", accounted >= driven + beside, branch.facts)


JUMPS = 2.0
"""So many `path_m` the battery's module has in its reach bound."""


LEMMAS: Final[dict[str, Lemma]] = {
    each.__name__: each
    for each in (
        lemma_1, kept_for_paths, beside_one_box, p3, legs, paths, lemma_3_boxes, lemma_3_pieces,
        lemma_3_fence, lemma_4_ac, lemma_4_sc,
        lemma_4_hand_over, apart_m, return_path,
    )
}  # fmt: skip
