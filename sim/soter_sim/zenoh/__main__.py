"""The simulated robots as a program; `python -m soter_sim.zenoh --help`."""

from __future__ import annotations

from soter.adapters.zenoh.programs import add_session, positive, read_session, refusing
from soter.adapters.zenoh.session import close_session, endpoints, open_session
from soter.onboard.program import Ending
from soter_sim.program import make_parser, read_namespaces, read_world, serve
from soter_sim.zenoh.endpoint import Endpoint


def main() -> None:
    """Run until interrupted or, with `--parent PID`, until that process is gone."""
    parser = make_parser("soter_sim.zenoh", "robots on Zenoh", "robot1")
    parser.add_argument("--speedup", type=positive, default=1.0, metavar="N", help="seconds of the world by second")
    add_session(parser)
    given = parser.parse_args()
    with refusing(parser):
        options = read_session(given)
        workspace, robots, limits = read_world()
        ended = Ending(given.parent)
        session = open_session(options)
        try:
            endpoint = Endpoint(
                workspace, robots, read_namespaces(given.namespaces), session, limits, stamped=given.stamped,
                truth_port=given.truth_port, speedup=given.speedup,
            )  # fmt: skip
            serve(endpoint, ended, control=endpoint.faults.control, endpoints=endpoints(session))
        finally:
            close_session(session)


if __name__ == "__main__":
    main()
