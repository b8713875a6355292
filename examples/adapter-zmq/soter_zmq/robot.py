"""The simulated robots as a program: `python -m soter_zmq.robot WORLD.json`.

It prints one line of JSON, `{"robots": {"1": {"command": ADDRESS, "report": ADDRESS}}, "truth": ADDRESS}`, and runs in
real time until it is interrupted or, with `--parent PID`, until that process is gone. It listens on this host only.

Every robot has a socket for commands and one for reports, and a clock that counts from its own start. What really
happens in the world is told on a socket of its own, in east and north, by who knows: not by the robots.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import secrets
import signal
import sys
import time
from pathlib import Path
from typing import Any, Final

import zmq

from soter_zmq.drive import drive
from soter_zmq.gate import Gate
from soter_zmq.wire import PERIOD_S, Command, Report, compass_deg
from soter_zmq.world import Body, World

_BOOT_APART_S: Final = 1000.0
"""Robots have been on for different times, so that nobody can mistake one's clock for another's."""

_LOOK_FOR_PARENT_STEPS: Final = 25


class SimulatedRobot:
    """One robot: its sockets, its gate, its drive.

    Args:
        context: for the sockets.
        body: its body in the world.
        address: where to listen.
        command_port: for commands; 0 for any that is free.
        report_port: the same, for reports.
    """

    def __init__(
        self, context: zmq.Context[zmq.Socket[bytes]], body: Body, address: str, command_port: int, report_port: int
    ) -> None:
        self.body: Final = body
        self.gate: Final = Gate()
        self._boot: Final = secrets.token_hex(4)
        self._booted_s: Final = -_BOOT_APART_S * body.id
        # CONFLATE keeps the last message only: a robot that was held up finds no queue of old commands.
        self.commands: Final = context.socket(zmq.PULL)
        self._reports: Final = context.socket(zmq.PUB)
        for socket, port in ((self.commands, command_port), (self._reports, report_port)):
            socket.setsockopt(zmq.CONFLATE, 1)
            socket.bind(f"tcp://{address}:{port or '*'}")

    @property
    def endpoints(self) -> dict[str, str]:
        """Where it listens and reports."""
        return {"command": _endpoint(self.commands), "report": _endpoint(self._reports)}

    def clock_s(self, world_s: float) -> float:
        """Return the robot's own time."""
        return world_s - self._booted_s

    def hear(self, world_s: float) -> None:
        """Take the command that has arrived; one that makes no sense is dropped."""
        try:
            command = Command.decode(self.commands.recv(zmq.NOBLOCK))
        except zmq.Again:
            return
        except ValueError as failure:
            print(f"robot {self.body.id}: dropped a message: {failure}", file=sys.stderr)
            return
        self.gate.take(command, self.clock_s(world_s))

    def control(self, world_s: float) -> None:
        """Choose what to steer for in the next period."""
        body = self.body
        goal = self.gate.passing(self.clock_s(world_s))
        body.wanted = drive(body.x_m, body.y_m, body.heading_rad, body.v_m_s, body.yaw_rate_rad_s, goal)

    def report(self, world_s: float) -> None:
        """Tell how it is, to whoever listens."""
        body, gate = self.body, self.gate
        report = Report(
            body.id, self._boot, gate.session, gate.seq, self.clock_s(world_s),
            body.y_m, body.x_m, compass_deg(body.heading_rad), body.v_m_s * math.sin(body.heading_rad),
            body.v_m_s * math.cos(body.heading_rad), -math.degrees(body.yaw_rate_rad_s), 100.0 * body.charge,
            gate.controller, None if gate.goal is None else gate.goal.id,
        )  # fmt: skip
        self._reports.send(report.encode(), zmq.NOBLOCK)


class Simulation:
    """A world and its robots, in real time.

    Args:
        values: the world, see `soter_zmq.simulator.describe`.
        ports: by robot, the ports of commands and reports; others take what is free.
        address: where to listen.
    """

    def __init__(self, values: dict[str, Any], ports: dict[int, tuple[int, int]], address: str = "127.0.0.1") -> None:
        self.world: Final = World.read(values)
        self._context: Final = zmq.Context()
        self._context.linger = 0
        self.robots: Final = [
            SimulatedRobot(self._context, body, address, *ports.get(body.id, (0, 0))) for body in self.world.bodies
        ]
        self._truth: Final = self._context.socket(zmq.PUB)
        self._truth.bind(f"tcp://{address}:*")

    @property
    def endpoints(self) -> dict[str, Any]:
        """Where everything is."""
        return {
            "robots": {str(robot.body.id): robot.endpoints for robot in self.robots},
            "truth": _endpoint(self._truth),
        }

    def run(self, parent: int | None) -> None:
        """Keep pace with the host's clock until the parent, if there is one, is gone."""
        world, robots = self.world, self.robots
        poller = zmq.Poller()
        for robot in robots:
            poller.register(robot.commands, zmq.POLLIN)
        began_s = time.perf_counter()
        while parent is None or world.steps % _LOOK_FOR_PARENT_STEPS or os.getppid() == parent:
            due_s = began_s + (world.steps + 1) * PERIOD_S
            arrived = poller.poll(max(0, math.ceil(1000.0 * (due_s - time.perf_counter()))))
            stepped = False
            # Who was held up first lives through what it has missed, with the commands that it had then.
            while began_s + (world.steps + 1) * PERIOD_S <= time.perf_counter():
                world.step()
                for robot in robots:
                    robot.control(world.now_s)
                stepped = True
            if arrived:
                for robot in robots:
                    robot.hear(world.now_s)
            if stepped:
                for robot in robots:
                    robot.report(world.now_s)
                self._truth.send(self._tell(), zmq.NOBLOCK)

    def close(self) -> None:
        """Close the sockets."""
        self._context.destroy()

    def _tell(self) -> bytes:
        world = self.world
        return json.dumps({
            "time_s": world.now_s,
            "poses": {body.id: (body.x_m, body.y_m, body.heading_rad) for body in world.bodies},
            "speeds": {body.id: (body.v_m_s, body.yaw_rate_rad_s) for body in world.bodies},
            "violations": world.violations,
            # JSON knows no infinity: a world without boxes has no margin to them.
            "min_margin": {rule: margin for rule, margin in world.min_margin.items() if math.isfinite(margin)},
            "contacts": world.contacts,
        }).encode()  # fmt: skip


def main() -> None:
    """Run the program."""
    parser = argparse.ArgumentParser(prog="python -m soter_zmq.robot", description="Simulated robots on ZeroMQ.")
    parser.add_argument("world", help="a JSON file, or - for standard input")
    parser.add_argument("--parent", type=int, help="end when this process is no longer the parent")
    parser.add_argument("--ports", default="", help="ports of the robots: 1=COMMAND,REPORT;2=COMMAND,REPORT")
    arguments = parser.parse_args()
    text = sys.stdin.read() if arguments.world == "-" else Path(arguments.world).read_text(encoding="utf-8")
    ports = {}
    for each in filter(None, arguments.ports.split(";")):
        robot_id, _, pair = each.partition("=")
        command, _, report = pair.partition(",")
        ports[int(robot_id)] = (int(command), int(report))
    simulation = Simulation(json.loads(text), ports)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    try:
        print(json.dumps(simulation.endpoints), flush=True)
        simulation.run(arguments.parent)
    except KeyboardInterrupt:
        pass
    finally:
        simulation.close()


def _endpoint(socket: zmq.Socket[bytes]) -> str:
    return bytes(socket.getsockopt(zmq.LAST_ENDPOINT)).rstrip(b"\0").decode()


if __name__ == "__main__":
    main()
