"""The engine with physics: rigid bodies in PyBullet, 240 steps a second.

Wheels are turned by velocity motors that follow their target within a step or two; acceleration is limited by moving
the target slowly.
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from math import atan2, cos, dist, remainder, sin, tau
from typing import Final

from soter.errors import BackendError
from soter.geometry.site import Site
from soter.geometry.workspace import Workspace
from soter.sdk.values import RobotSpec, RuleLimits
from soter_sim.bodies import BODY_RADIUS_M, Bodies
from soter_sim.engine import MOST_BOXES, boxes_of_map
from soter_sim.judge import Judge


@contextmanager
def nothing_printed() -> Iterator[None]:
    """Drop what C code prints: PyBullet prints a greeting when it is imported, and messages about windows."""
    sys.stdout.flush()
    nothing, kept = os.open(os.devnull, os.O_WRONLY), {stream: os.dup(stream) for stream in (1, 2)}
    try:
        for stream in kept:
            os.dup2(nothing, stream)
        yield
    finally:
        # Otherwise C would print its buffered output once its stdout is restored.
        ctypes.CDLL(None).fflush(None)
        for stream, before in kept.items():
            os.dup2(before, stream)
            os.close(before)
        os.close(nothing)


with nothing_printed():
    import pybullet as bullet

__all__ = ["BODY", "PERIOD_S", "STEPS_PER_PERIOD", "PyBulletEngine", "bullet", "nothing_printed"]

PERIOD_S: Final = 0.05
"""The control period."""

STEPS_PER_PERIOD: Final = 12
"""Physics steps in a control period: 240 Hz."""

_STEP_S: Final = PERIOD_S / STEPS_PER_PERIOD
_WHEEL_RADIUS_M: Final = 0.033
_WHEEL_AT_M: Final = 0.07
_MOTOR_N_M: Final = 10.0
_BODY_KG: Final = 0.9
_WHEEL_KG: Final = 0.05
# That of a motor behind its gear. With lighter wheels the library takes far longer to find the forces.
_WHEEL_KG_M2: Final = 1e-3
_SHOWN_M: Final = 0.15
# A robot is a chain of joints that begins where the robot does: it moves east, north and up, turns, and rolls to its
# side, so that both wheels carry it. It cannot lean forward, and needs nothing that keeps it from that.
_EAST, _NORTH, _UP, _TURN, _ROLL, *_WHEELS = range(7)
_AXES: Final = (
    (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0),
    (0.0, 1.0, 0.0), (0.0, 1.0, 0.0),
)  # fmt: skip
_PARENTS: Final = (0, 1, 2, 3, 4, 5, 5)
_NOT_DRIVEN: Final = (_EAST, _NORTH, _UP, _TURN, _ROLL)
_BARE_KG: Final = 1e-6
BODY: Final = _ROLL
"""The link of a robot that is its body: a sphere, since of all round shapes the library knows only its exact distance.

It reaches below the ground, which it does not touch.
"""

# What may touch what, in bits.
_GROUND, _WHEEL, _ROBOT, _WALL = 1, 2, 4, 8
# Motors lag behind their target by about a step; they still stop within the promised distance.
_BRAKE: Final = 1.06
# No robot is faster than this many times its top speed, even after a push by another robot of the same speed.
_BOUND: Final = 2.0
_BOUND_M_S: Final = 0.5


class PyBulletEngine:
    """Differential-drive robots as rigid bodies; implements `soter_sim.engine.Engine`.

    Stepping is deterministic, bit for bit, also in another process.

    Args:
        workspace: fence, boxes and chargers.
        specs: the robots and where they start.
        limits: what the mission promises.

    Raises:
        BackendError: PyBullet has no room for another world in this process.
    """

    def __init__(
        self,
        workspace: Workspace,
        specs: Sequence[RobotSpec],
        limits: RuleLimits = RuleLimits(),  # noqa: B008 - frozen
    ) -> None:
        self.bodies = Bodies(specs)
        self.period_s = PERIOD_S
        fastest_m_s = max(each.v_max_m_s for each in self.bodies.limits)
        self._bound_m_s = max(_BOUND_M_S, _BOUND * fastest_m_s)
        self._judge = Judge(workspace, self.bodies, _STEP_S, self._bound_m_s, limits)
        self.record = self._judge.record
        self._done = 0
        count = len(specs)
        self._to_x, self._to_y = [*self.bodies.x], [*self.bodies.y]
        self._v_target, self._w_target = [0.0] * count, [0.0] * count
        self._east, self._north = [0.0] * count, [0.0] * count
        self._begins = [(spec.x_m, spec.y_m) for spec in specs]
        self._client = self._connect()
        if self._client < 0:
            raise BackendError("PyBullet cannot open another world in this process: too many are open; close some")
        try:
            self._boxes = self._build(workspace)
            self._robots = [self._put(spec, radius_m) for spec, radius_m in zip(specs, self.bodies.radius, strict=True)]
        except BaseException:
            self.close()
            raise

    def run(self, until_period: int) -> None:
        if self._client < 0:
            return
        client = self._client
        judge, bodies = self._judge, self.bodies
        to_x, to_y = self._to_x, self._to_y
        for period in range(self._done, until_period):
            ramps = self._ramps(period * PERIOD_S)
            first = period * STEPS_PER_PERIOD
            fresh = True
            for step in range(first, first + STEPS_PER_PERIOD):
                for ramp in ramps:
                    self._turn_wheels(*ramp)
                looks = step >= judge.due
                if looks and not fresh:
                    self._read_places(bodies.x, bodies.y)
                bullet.stepSimulation(physicsClientId=client)
                fresh = looks
                if looks:
                    self._read_places(to_x, to_y)
                    self._find_contacts(step)
                    judge.look(step, to_x, to_y)
                    bodies.x[:] = to_x
                    bodies.y[:] = to_y
            self._read_all()
            self._done = period + 1

    def velocity(self, index: int) -> tuple[float, float]:
        return self._east[index], self._north[index]

    def close(self) -> None:
        client, self._client = self._client, -1
        if client >= 0:
            bullet.disconnect(physicsClientId=client)

    # --- building ------------------------------------------------------------------------------------------

    def _connect(self) -> int:
        """Make an empty world; return its number, or less than zero."""
        return bullet.connect(bullet.DIRECT)

    def _build(self, workspace: Workspace) -> frozenset[int]:
        """Set up the ground and the boxes, whose height counts for nothing, as in the truth; return the boxes' ids."""
        client, least_m = self._client, 2.0 * _WHEEL_RADIUS_M
        bullet.setGravity(0.0, 0.0, -9.81, physicsClientId=client)
        bullet.setTimeStep(_STEP_S, physicsClientId=client)
        # The defaults let bodies overlap by 0.01 mm, and for several steps, and end at forces that are not found yet.
        bullet.setPhysicsEngineParameter(
            contactSlop=0.0, contactERP=0.8, numSolverIterations=100, physicsClientId=client
        )
        shape = bullet.createCollisionShape(bullet.GEOM_PLANE, physicsClientId=client)
        ground = bullet.createMultiBody(0.0, shape, physicsClientId=client)
        bullet.changeDynamics(ground, -1, lateralFriction=1.0, restitution=0.0, physicsClientId=client)
        bullet.setCollisionFilterGroupMask(ground, -1, _GROUND, _WHEEL, physicsClientId=client)
        if isinstance(workspace, Site) and (grid := workspace.plan.map) is not None:
            if (many := boxes_of_map(workspace)) > MOST_BOXES:
                raise BackendError(
                    f"the map is made of {many} boxes, PyBullet takes {MOST_BOXES}; use the backend "
                    "kinematic, or a map with larger cells or less noise"
                )
            return frozenset(self._put_box(ring, max(grid.height_m, least_m)) for ring in grid.rings())
        if isinstance(workspace, Site):
            return frozenset(self._put_walls(area.ring, max(area.height_m, least_m)) for area in workspace.plan.areas)
        _, rings = workspace.outlines()
        boxes = zip(rings, workspace.boxes, strict=True)
        return frozenset(self._put_box(ring, max(box.height_m, least_m)) for ring, box in boxes)

    def _put_box(self, ring: Sequence[tuple[float, float]], height_m: float) -> int:
        """Put a rectangle on the ground as a box; return its body's id."""
        client = self._client
        (ax, ay), (bx, by), (cx, cy), _ = ring
        yaw = atan2(by - ay, bx - ax)
        half = (dist(ring[0], ring[1]) / 2, dist(ring[1], ring[2]) / 2, height_m / 2)
        shape = bullet.createCollisionShape(bullet.GEOM_BOX, halfExtents=half, physicsClientId=client)
        body = bullet.createMultiBody(
            0.0,
            shape,
            basePosition=((ax + cx) / 2, (ay + cy) / 2, height_m / 2),
            baseOrientation=(0.0, 0.0, sin(yaw / 2), cos(yaw / 2)),
            physicsClientId=client,
        )
        return self._made_wall(int(body))

    def _put_walls(self, ring: Sequence[tuple[float, float]], height_m: float) -> int:
        """Put the walls of a polygon of any shape on the ground; return their body's id.

        They are triangles: of vertices alone the library makes a convex hull, and rounds it to 1/10 000 of its extent.
        """
        client, count = self._client, len(ring)
        middle_x, middle_y = sum(x for x, _ in ring) / count, sum(y for _, y in ring) / count
        vertices = [(x - middle_x, y - middle_y, z) for x, y in ring for z in (0.0, height_m)]
        walls = [(2 * at, 2 * ((at + 1) % count)) for at in range(count)]
        indices = [corner for a, b in walls for corner in (a, b, b + 1, a, b + 1, a + 1)]
        shape = bullet.createCollisionShape(
            bullet.GEOM_MESH, vertices=vertices, indices=indices, physicsClientId=client
        )  # fmt: skip
        body = bullet.createMultiBody(0.0, shape, basePosition=(middle_x, middle_y, 0.0), physicsClientId=client)
        return self._made_wall(int(body))

    def _made_wall(self, body: int) -> int:
        """Let a body stop robots; return it."""
        client = self._client
        # With a margin, the library makes bodies larger on every side, and rounds the corners of boxes.
        bullet.changeDynamics(body, -1, restitution=0.0, collisionMargin=0.0, physicsClientId=client)
        bullet.setCollisionFilterGroupMask(body, -1, _WALL, _ROBOT, physicsClientId=client)
        return body

    def _put(self, spec: RobotSpec, radius_m: float) -> int:
        """Put a robot on the ground, its motors braked; return its body's id."""
        client, scale = self._client, radius_m / BODY_RADIUS_M
        body, wheel = (
            bullet.createCollisionShape(bullet.GEOM_SPHERE, radius=each_m, physicsClientId=client)
            for each_m in (radius_m, _WHEEL_RADIUS_M)
        )
        shown = bullet.createVisualShape(
            bullet.GEOM_CYLINDER, radius=radius_m, length=_SHOWN_M * scale,
            visualFramePosition=(0.0, 0.0, _SHOWN_M * scale / 2), physicsClientId=client,
        )  # fmt: skip
        bare, joints, middle, level = len(_NOT_DRIVEN) - 1, len(_AXES), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)
        slides, turns = bullet.JOINT_PRISMATIC, bullet.JOINT_REVOLUTE
        aside_m = _WHEEL_AT_M * scale
        robot = bullet.createMultiBody(
            basePosition=(spec.x_m, spec.y_m, _WHEEL_RADIUS_M),
            linkMasses=[*[_BARE_KG] * bare, _BODY_KG, _WHEEL_KG, _WHEEL_KG],
            linkCollisionShapeIndices=[*[-1] * bare, body, wheel, wheel],
            linkVisualShapeIndices=[*[-1] * bare, shown, -1, -1],
            linkPositions=[*[middle] * len(_NOT_DRIVEN), (0.0, aside_m, 0.0), (0.0, -aside_m, 0.0)],
            linkOrientations=[level] * joints,
            linkInertialFramePositions=[middle] * joints,
            linkInertialFrameOrientations=[level] * joints,
            linkParentIndices=_PARENTS,
            linkJointTypes=[slides if joint in (_EAST, _NORTH, _UP) else turns for joint in range(joints)],
            linkJointAxis=_AXES,
            physicsClientId=client,
        )
        bullet.resetJointState(robot, _TURN, spec.heading_rad, physicsClientId=client)
        # That of a cube around the robot.
        body_kg_m2 = _BODY_KG * (2.0 * radius_m) ** 2 / 6.0
        for link, inertia in ((BODY, body_kg_m2), *((wheel_link, _WHEEL_KG_M2) for wheel_link in _WHEELS)):
            bullet.changeDynamics(robot, link, localInertiaDiagonal=[inertia] * 3, physicsClientId=client)
        for link in range(joints):
            driven = link in _WHEELS
            # The body slides along what it touches. Larger bodies need more grip: the force to turn as fast grows with
            # the radius, but their weight does not.
            bullet.changeDynamics(
                robot, link, lateralFriction=max(1.0, scale) if driven else 0.0, spinningFriction=0.0,
                rollingFriction=0.0, restitution=0.0, linearDamping=0.0, angularDamping=0.0, jointDamping=0.0,
                physicsClientId=client,
            )  # fmt: skip
            group, touches = (_WHEEL, _GROUND) if driven else (_ROBOT, _ROBOT | _WALL)
            bullet.setCollisionFilterGroupMask(robot, link, group, touches, physicsClientId=client)
        self._drive(robot, _NOT_DRIVEN, [0.0] * len(_NOT_DRIVEN), 0.0)
        self._drive(robot, _WHEELS, (0.0, 0.0), _MOTOR_N_M)
        return int(robot)

    def _drive(self, robot: int, joints: Sequence[int], rad_s: Sequence[float], most: float) -> None:
        """Let motors of at most this torque, or force, turn joints at these speeds."""
        bullet.setJointMotorControlArray(
            robot, joints, bullet.VELOCITY_CONTROL, targetVelocities=rad_s, forces=[most] * len(joints),
            physicsClientId=self._client,
        )  # fmt: skip

    # --- steering ------------------------------------------------------------------------------------------

    def _ramps(self, now_s: float) -> list[tuple[int, float, float]]:
        """Call every robot's control, use charge, and return the targets to move in this period, and where to."""
        bodies, judge = self.bodies, self._judge
        ramps = []
        for i, control in enumerate(bodies.control):
            v_to, w_to = control(now_s, bodies.x[i], bodies.y[i], bodies.heading[i], bodies.v[i], bodies.yaw_rate[i])
            v_to = _clamped(v_to, bodies.limits[i].v_max_m_s)
            w_to = _clamped(w_to, bodies.limits[i].yaw_rate_max_rad_s)
            if bodies.charge[i] <= 0.0:
                v_to = w_to = 0.0
            v_is, w_is = self._v_target[i], self._w_target[i]
            self._use_charge(i, now_s, abs(v_is), abs(w_is))
            if v_to != v_is or w_to != w_is:
                ramps.append((i, v_to, w_to))
        judge.record.min_margin["battery"] = min(judge.record.min_margin["battery"], *bodies.charge)
        return ramps

    def _use_charge(self, i: int, now_s: float, v: float, yaw_rate: float) -> None:
        """Charge, or use charge, for one period with the wheels commanded to these speeds."""
        bodies, judge, limits = self.bodies, self._judge, self.bodies.limits[i]
        charge, on_charger = bodies.charge, judge.on_charger[i]
        left = charge[i]
        if on_charger and v == 0.0 and yaw_rate == 0.0:
            if left <= 0.0:
                judge.charged(i, now_s)
            charge[i] = min(left + bodies.charge_per_s[i] * PERIOD_S, 1.0)
        elif left > 0.0:
            effort = max(v / limits.v_max_m_s, yaw_rate / limits.yaw_rate_max_rad_s)
            idle = bodies.idle_per_s[i]
            use = (idle + (bodies.drive_per_s[i] - idle) * effort) * PERIOD_S
            if left <= use:
                if not on_charger:
                    judge.flat(i, now_s + left / use * PERIOD_S)
                charge[i] = 0.0
            else:
                charge[i] = left - use
        elif not on_charger:
            judge.flat(i, now_s)

    def _turn_wheels(self, i: int, v_to: float, w_to: float) -> None:
        """Move a robot's target by as much as one physics step allows."""
        v_is, w_is = self._v_target[i], self._w_target[i]
        if v_is == v_to and w_is == w_to:
            return
        # Speeding up is slower than braking, which also covers the first part of a reversal.
        speeds_up, limits = (v_to - v_is) * v_is >= 0.0, self.bodies.limits[i]
        v = _moved(v_is, v_to, (limits.accel_m_s2 if speeds_up else _BRAKE * limits.brake_m_s2) * _STEP_S)
        w = _moved(w_is, w_to, limits.yaw_accel_rad_s2 * _STEP_S)
        self._v_target[i], self._w_target[i] = v, w
        turning = w * _WHEEL_AT_M / BODY_RADIUS_M * self.bodies.radius[i]
        wheels_rad_s = (v - turning) / _WHEEL_RADIUS_M, (v + turning) / _WHEEL_RADIUS_M
        self._drive(self._robots[i], _WHEELS, wheels_rad_s, _MOTOR_N_M)

    # --- reading -------------------------------------------------------------------------------------------

    def _read_places(self, x: list[float], y: list[float]) -> None:
        for i, (robot, (begin_x, begin_y)) in enumerate(zip(self._robots, self._begins, strict=True)):
            east, north = bullet.getJointStates(robot, (_EAST, _NORTH), physicsClientId=self._client)
            x[i], y[i] = begin_x + east[0], begin_y + north[0]

    def _read_all(self) -> None:
        bodies, client = self.bodies, self._client
        for i, (robot, (begin_x, begin_y)) in enumerate(zip(self._robots, self._begins, strict=True)):
            states = bullet.getJointStates(robot, (_EAST, _NORTH, _TURN), physicsClientId=client)
            (x, east, *_), (y, north, *_), (turned_rad, yaw_rate, *_) = states
            bodies.x[i], bodies.y[i] = begin_x + x, begin_y + y
            heading = remainder(turned_rad, tau)
            bodies.heading[i], bodies.yaw_rate[i] = heading, yaw_rate
            bodies.v[i] = east * cos(heading) + north * sin(heading)
            self._east[i], self._north[i] = east, north

    def _find_contacts(self, step: int) -> None:
        """Tell the judge which robots press against boxes or each other at the end of a step."""
        judge, client, robots = self._judge, self._client, self._robots
        for i, due in enumerate(judge.box_due):
            # A contact point exists before bodies touch; it has a force once they do.
            if due <= step and any(
                point[2] in self._boxes and point[9] > 0.0
                for point in bullet.getContactPoints(bodyA=robots[i], physicsClientId=client)
            ):
                judge.hit_box(i, (step + 1) * _STEP_S)
        for pair in judge.pairs:
            if pair.due <= step and self._near(pair.i, pair.j):
                points = bullet.getContactPoints(bodyA=robots[pair.i], bodyB=robots[pair.j], physicsClientId=client)
                if any(point[9] > 0.0 for point in points):
                    judge.hit_robot(pair.i, pair.j, (step + 1) * _STEP_S)

    def _near(self, i: int, j: int) -> bool:
        dx, dy = self._to_x[j] - self._to_x[i], self._to_y[j] - self._to_y[i]
        radius = self.bodies.radius
        reach = radius[i] + radius[j] + 2.0 * self._bound_m_s * _STEP_S
        return dx * dx + dy * dy < reach * reach


def _clamped(value: float, limit: float) -> float:
    """Return a command within its limit; 0 for NaN."""
    if -limit <= value <= limit:
        return value
    return limit if value > limit else -limit if value < -limit else 0.0


def _moved(value: float, to: float, most: float) -> float:
    """Return `value` moved towards `to` by at most `most`."""
    if value < to:
        return min(value + most, to)
    return max(value - most, to)
