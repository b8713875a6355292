"""The engine with physics: rigid bodies in PyBullet, 240 steps a second.

Wheels are turned by velocity motors that follow their target within a step or two; acceleration is limited by moving
the target slowly.
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from importlib.resources import files
from math import atan2, cos, dist, sin
from typing import Final

from soter.errors import BackendError
from soter.geometry.site import Site
from soter.geometry.workspace import Workspace
from soter.scratch import Scratch
from soter.sdk.values import RobotSpec, RuleLimits
from soter_sim.bodies import BODY_RADIUS_M, Bodies
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

__all__ = ["PERIOD_S", "STEPS_PER_PERIOD", "PyBulletEngine", "bullet", "nothing_printed"]

PERIOD_S: Final = 0.05
"""The control period."""

STEPS_PER_PERIOD: Final = 12
"""Physics steps in a control period: 240 Hz."""

_STEP_S: Final = PERIOD_S / STEPS_PER_PERIOD
_WHEEL_RADIUS_M: Final = 0.033
_WHEEL_AT_M: Final = 0.07
_WHEELS: Final = (0, 1)
_ALL_LINKS: Final = (-1, *_WHEELS)
_MOTOR_N_M: Final = 10.0
_BODY_KG: Final = 0.9
# Bodies are thin discs near the wheels' axis, where rocking hardly moves them.
_DISC_M: Final = 0.004
# Height of the sliders: they hang slightly above the ground, and a body rocks from one to the other when it brakes, and
# turns its wheels with it. If the gap grew with the model, a robot of 1 m would brake 0.04 m/s late.
_SLIDER_AT_M: Final = -0.0198
_SLIDER_GAP_M: Final = 0.0002
# A robot does 0.22001 m/s when told 0.22. With this part of its top speed it stays below.
_TOP_SPEED: Final = 0.9995
# Motors lag behind their target by about a step; they still stop within the promised distance.
_BRAKE: Final = 1.06
# No robot is faster than this many times its top speed, even after a push by another robot of the same speed.
_BOUND: Final = 2.0
_BOUND_M_S: Final = 0.5
_MOST_BOXES: Final = 10_000


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
        # The model is a robot of the default radius, scaled for others.
        self._scale = [radius_m / BODY_RADIUS_M for radius_m in self.bodies.radius]
        self._v_target, self._w_target = [0.0] * count, [0.0] * count
        self._east, self._north = [0.0] * count, [0.0] * count
        self._client = self._connect()
        if self._client < 0:
            raise BackendError("PyBullet cannot open another world in this process: too many are open; close some")
        try:
            self._boxes = self._build(workspace)
            self._robots = [self._put(spec, scale) for spec, scale in zip(specs, self._scale, strict=True)]
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
        client, least_m = self._client, 2.0 * _WHEEL_RADIUS_M * min(self._scale)
        bullet.setGravity(0.0, 0.0, -9.81, physicsClientId=client)
        bullet.setTimeStep(_STEP_S, physicsClientId=client)
        # The defaults let bodies overlap by 0.01 mm, and for several steps.
        bullet.setPhysicsEngineParameter(contactSlop=0.0, contactERP=0.8, physicsClientId=client)
        shape = bullet.createCollisionShape(bullet.GEOM_PLANE, physicsClientId=client)
        ground = bullet.createMultiBody(0.0, shape, physicsClientId=client)
        bullet.changeDynamics(ground, -1, lateralFriction=1.0, restitution=0.0, physicsClientId=client)
        if isinstance(workspace, Site) and (grid := workspace.plan.map) is not None:
            if len(rings := grid.rings()) > _MOST_BOXES:
                raise BackendError(
                    f"the map is made of {len(rings)} boxes, PyBullet takes {_MOST_BOXES}; use the backend "
                    "kinematic, or a map with larger cells or less noise"
                )
            return frozenset(self._put_box(ring, max(grid.height_m, least_m)) for ring in rings)
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
        bullet.changeDynamics(body, -1, restitution=0.0, collisionMargin=0.0, physicsClientId=client)
        return int(body)

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
        # With a margin, the library makes bodies larger on every side, and rounds the corners of boxes.
        bullet.changeDynamics(body, -1, restitution=0.0, collisionMargin=0.0, physicsClientId=client)
        return body

    def _put(self, spec: RobotSpec, scale: float) -> int:
        """Put a robot on the ground, its motors braked; return its body's id."""
        client = self._client
        with closing(Scratch("robot")) as folder:
            model = folder.path / "robot.urdf"
            model.write_text(_model(scale, min(self._scale)))
            robot = bullet.loadURDF(
                str(model),
                basePosition=(spec.x_m, spec.y_m, scale * _WHEEL_RADIUS_M),
                globalScaling=scale,
                flags=bullet.URDF_USE_IMPLICIT_CYLINDER,
                baseOrientation=(0.0, 0.0, sin(spec.heading_rad / 2), cos(spec.heading_rad / 2)),
                physicsClientId=client,
            )
        bullet.changeDynamics(
            robot, -1, localInertiaDiagonal=_inertia_kg_m2(scale), collisionMargin=0.0, physicsClientId=client
        )  # fmt: skip
        for link in _ALL_LINKS:
            bullet.changeDynamics(
                robot,
                link,
                # The body slides along what it touches, and so do the two sliders that keep it upright. Larger bodies
                # need more grip: the force to turn as fast grows with the radius, but their weight does not.
                lateralFriction=0.0 if link < 0 else max(1.0, scale),
                spinningFriction=0.0,
                rollingFriction=0.0,
                restitution=0.0,
                linearDamping=0.0,
                angularDamping=0.0,
                physicsClientId=client,
            )
        bullet.setJointMotorControlArray(
            robot,
            _WHEELS,
            bullet.VELOCITY_CONTROL,
            targetVelocities=(0.0, 0.0),
            forces=(_MOTOR_N_M, _MOTOR_N_M),
            physicsClientId=client,
        )
        return robot

    # --- steering ------------------------------------------------------------------------------------------

    def _ramps(self, now_s: float) -> list[tuple[int, float, float]]:
        """Call every robot's control, use charge, and return the targets to move in this period, and where to."""
        bodies, judge = self.bodies, self._judge
        ramps = []
        for i, control in enumerate(bodies.control):
            v_to, w_to = control(now_s, bodies.x[i], bodies.y[i], bodies.heading[i], bodies.v[i], bodies.yaw_rate[i])
            v_to = _clamped(v_to, _TOP_SPEED * bodies.limits[i].v_max_m_s)
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
        turning, wheel_m = w * _WHEEL_AT_M * self._scale[i], _WHEEL_RADIUS_M * self._scale[i]
        bullet.setJointMotorControlArray(
            self._robots[i],
            _WHEELS,
            bullet.VELOCITY_CONTROL,
            targetVelocities=((v - turning) / wheel_m, (v + turning) / wheel_m),
            forces=(_MOTOR_N_M, _MOTOR_N_M),
            physicsClientId=self._client,
        )

    # --- reading -------------------------------------------------------------------------------------------

    def _read_places(self, x: list[float], y: list[float]) -> None:
        # PyBullet returns the centre of mass, which the model has on the wheels' axis, at the robot's position.
        for i, robot in enumerate(self._robots):
            position, _ = bullet.getBasePositionAndOrientation(robot, physicsClientId=self._client)
            x[i], y[i] = position[0], position[1]

    def _read_all(self) -> None:
        bodies, client = self.bodies, self._client
        for i, robot in enumerate(self._robots):
            (x, y, _), (qx, qy, qz, qw) = bullet.getBasePositionAndOrientation(robot, physicsClientId=client)
            (east, north, _), (_, _, yaw_rate) = bullet.getBaseVelocity(robot, physicsClientId=client)
            heading = atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))
            bodies.x[i], bodies.y[i], bodies.heading[i] = x, y, heading
            bodies.v[i] = east * cos(heading) + north * sin(heading)
            bodies.yaw_rate[i] = yaw_rate
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


def _model(scale: float, smallest: float) -> str:
    """Return the model of a robot, scaled except for the sliders' gap and the body.

    All bodies are at the height of the smallest robot's wheels' axis, so that their round sides meet.
    """
    model = (files("soter_sim") / "data" / "burger.urdf").read_text()
    figures = {
        "SLIDER_AT": _SLIDER_AT_M - _SLIDER_GAP_M * max(1.0 - 1.0 / scale, 0.0),
        "BODY_AT": _WHEEL_RADIUS_M * (smallest / scale - 1.0),
        "BODY_HEIGHT": _DISC_M / scale,
    }
    for name, figure in figures.items():
        model = model.replace(name, str(figure))
    return model


def _inertia_kg_m2(scale: float) -> tuple[float, float, float]:
    """Return a body's moments of inertia, about its own axes: those of a cube around the robot."""
    inertia = _BODY_KG * (2.0 * scale * BODY_RADIUS_M) ** 2 / 6.0
    return inertia, inertia, inertia


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
