"""The simulated robots as a program; `python -m soter_sim.ros2 --help`."""

from __future__ import annotations

from soter.onboard.program import Ending
from soter_sim.program import make_parser, read_namespaces, read_world, serve
from soter_sim.ros2.endpoint import Endpoint


def main() -> None:
    """Run until interrupted or, with `--parent PID`, until that process is gone."""
    given = make_parser("soter_sim.ros2", "ROS 2 robots", "/robot1").parse_args()
    workspace, robots, limits = read_world()
    ended = Ending(given.parent)
    namespaces = read_namespaces(given.namespaces)
    endpoint = Endpoint(workspace, robots, namespaces, limits, stamped=given.stamped, truth_port=given.truth_port)
    serve(endpoint, ended, control=endpoint.faults.control)


if __name__ == "__main__":
    main()
