"""`soter zenoh-router`: a Zenoh router, where none is installed."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from soter.cli.exits import StopSignals, guard
from soter.cli.option import option, switch
from soter.cli.plain import emit

if TYPE_CHECKING:
    from soter.adapters.zenoh.session import SessionOptions

EXAMPLES = """Examples:
  soter zenoh-router
  soter zenoh-router --listen tcp/127.0.0.1:7448 --connect tcp/127.0.0.1:7447
  soter zenoh-router --listen tls/192.0.2.7:7447 --root-ca ca.pem --certificate router.pem --private-key router.key
Exit codes:
  0  ended by Ctrl-C or a request to terminate
  2  bad input, an endpoint that is taken, or Zenoh is not there
"""

_LOOK_S = 0.1


def zenoh_router(
    listen: Annotated[
        list[str] | None, option("E", "Where it listens; may be repeated; tcp/127.0.0.1:7447 if not given.")
    ] = None,
    connect: Annotated[list[str] | None, option("E", "Another router to share with; may be repeated.")] = None,
    session: Annotated[
        Path | None, option("FILE", "All about its session: the keys of \\[backends.zenoh.session], as TOML.")
    ] = None,
    root_ca: Annotated[
        Path | None, option("FILE", "Encrypt, and believe the certificates of these authorities.")
    ] = None,
    certificate: Annotated[Path | None, option("FILE", "The router's certificate.")] = None,
    private_key: Annotated[Path | None, option("FILE", "The certificate's private key.")] = None,
    anonymous: Annotated[bool, switch("--anonymous", "Encrypt, but let clients in that have no certificate.")] = False,
    users: Annotated[Path | None, option("FILE", "Let only these users in: NAME:PASSWORD, a line each.")] = None,
    unencrypted: Annotated[
        bool, switch("--unencrypted", "Do without encryption beyond this host: on closed networks only.")
    ] = False,
    allow_all_interfaces: Annotated[
        bool, switch("--allow-all-interfaces", "Let --listen name 0.0.0.0 or \\[::].")
    ] = False,
    parent: Annotated[int | None, option("PID", "End when this process is no longer the parent.", hidden=True)] = None,
) -> None:
    """Pass on between Zenoh clients, until Ctrl-C. Only this host reaches it unless told otherwise.

    It is an ordinary session in the mode of a router, for trying a routed network; Zenoh's own is zenohd.
    """
    with guard(), StopSignals() as stop:
        from soter.adapters.zenoh.programs import session_options
        from soter.adapters.zenoh.session import close_session, endpoints, open_session

        told: dict[str, Any] = {
            "mode": "router",
            "listen": listen or None,
            "connect": connect or None,
            "users_file": None if users is None else str(users),
            "unencrypted": unencrypted or None,
            "allow_all_interfaces": allow_all_interfaces or None,
        }
        tls = {"root_ca": root_ca, "certificate": certificate, "private_key": private_key}
        if anonymous or any(tls.values()):
            told["tls"] = {key: str(value) for key, value in tls.items() if value} | {"mutual": not anonymous}
        options = session_options(session, **told)
        opened = open_session(options)
        try:
            _say_how_to_connect(endpoints(opened), options)
            connected = 0
            while not stop() and (parent is None or os.getppid() == parent):
                time.sleep(_LOOK_S)
                before, connected = connected, len(opened.info.transports())
                if connected != before:
                    emit(f"connected: {connected}")
        finally:
            close_session(opened)


def _say_how_to_connect(where: list[str], options: SessionOptions) -> None:
    """Print the keys of a mission file and the options of other programs that connect to the router."""
    emit(f"A Zenoh router listens at {', '.join(where)}.\n\nIn a mission file:\n")
    lines = ["[backends.zenoh.session]", 'mode = "client"', f"connect = [{', '.join(map(repr, where))}]"]
    if (tls := options.tls) is not None:
        own = 'certificate = "…", private_key = "…"' if tls.mutual else "mutual = false"
        lines.append(f'tls = {{ root_ca = "{tls.root_ca}", {own} }}')
    elif options.unencrypted:
        lines.append("unencrypted = true")
    if options.users_file is not None:
        lines.append('username = "…"\npassword_file = "…"')
    emit("\n".join(lines))
    given = "--session FILE, with these keys in it" if len(lines) > 3 else f"--mode client --connect {where[0]}"
    emit(f"\nsoter zenoh-mux, soter sim zenoh: {given}\n\nCtrl-C ends it.")
