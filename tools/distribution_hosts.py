"""Hosts for a distributed mission on one computer: network namespaces with cables between them, or loopback.

Where namespaces are not permitted, everybody is on loopback, and what would be a cable is a proxy that can be cut.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import selectors
import socket
import subprocess
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Final, Protocol

WORLD: Final = "world"
ROUTER: Final = "router"

_CLONE_NEWNET: Final = 0x40000000
_CHUNK: Final = 1 << 16


class Hosts(Protocol):
    """Where processes run, and how they reach each other.

    Attributes:
        kind: in a word.
        world: the address at which the simulated world listens for the robots' own processes.
        truth_reaches: whether processes elsewhere can ask the world for the truth.
    """

    kind: str
    world: str
    truth_reaches: bool

    def command(self, host: str, arguments: Sequence[str]) -> list[str]:
        """Return a command that runs on a host."""

    def router(self) -> str:
        """Return the address at which the router is to listen, as `host:port`; port 0 for any."""

    def reach_router(self, process: str, router: str) -> str:
        """Return the address at which a process reaches the router, which listens at another."""

    def connect(self, host: str, address: str) -> socket.socket:
        """Return a connection made on a host."""

    def cut(self, process: str) -> None:
        """Pull the cable between a process and the router."""

    def heal(self, process: str) -> None:
        """Plug it in again."""

    def close(self) -> None:
        """Take everything down. Idempotent."""


class Namespaces:
    """A network namespace a host. Robots' processes have a cable to the world and one to the router, others the latter.

    Nothing is forwarded between cables: what passes between processes passes through the router.

    Args:
        robots: names of the processes with robots.
        others: names of the rest.

    Raises:
        OSError: it is not permitted, or there is no `ip`.
    """

    kind = "network namespaces"
    truth_reaches = False

    def __init__(self, robots: Sequence[str], others: Sequence[str]) -> None:
        self._prefix: Final = f"st{os.getpid()}"
        self._made: Final[list[str]] = []
        self._networks: Final[dict[str, str]] = {}
        self.world = "10.77.0.1"
        self._router: Final = "10.78.0.1"
        try:
            for host in (WORLD, ROUTER, *robots, *others):
                self._run("netns", "add", self._name(host))
                self._made.append(host)
                self._in(host, "link", "set", "lo", "up")
            self._in(WORLD, "address", "add", f"{self.world}/32", "dev", "lo")
            self._in(ROUTER, "address", "add", f"{self._router}/32", "dev", "lo")
            for number, host in enumerate((*robots, *others), start=1):
                self._plug(ROUTER, self._router, host, f"10.78.{number}")
                if host in robots:
                    self._plug(WORLD, self.world, host, f"10.77.{number}")
        except BaseException:
            self.close()
            raise

    def command(self, host: str, arguments: Sequence[str]) -> list[str]:
        return ["ip", "netns", "exec", self._name(host), *arguments]

    def router(self) -> str:
        return f"{self._router}:7447"

    def reach_router(self, process: str, router: str) -> str:
        return router

    def connect(self, host: str, address: str) -> socket.socket:
        """Return a connection made on a host: the thread visits its namespace for as long as that takes."""
        setns = ctypes.CDLL(None, use_errno=True).setns
        name, _, port = address.rpartition(":")
        with Path("/proc/thread-self/ns/net").open() as home, Path(f"/run/netns/{self._name(host)}").open() as there:
            if setns(there.fileno(), _CLONE_NEWNET):
                raise OSError(ctypes.get_errno(), "cannot enter the namespace")
            try:
                return socket.create_connection((name, int(port)), 5.0)
            finally:
                setns(home.fileno(), _CLONE_NEWNET)

    def cut(self, process: str) -> None:
        self._in(ROUTER, "link", "set", process, "down")

    def heal(self, process: str) -> None:
        self._in(ROUTER, "link", "set", process, "up")
        # The kernel forgets routes over a cable that was pulled on this side only.
        network = self._networks[process]
        self._in(ROUTER, "address", "replace", f"{network}.1/24", "dev", process)

    def close(self) -> None:
        while self._made:
            with contextlib.suppress(OSError):
                self._run("netns", "delete", self._name(self._made.pop()))

    def _plug(self, hub: str, hub_address: str, host: str, network: str) -> None:
        """Lay a cable between a hub and a host; either end is called after what is at the other."""
        if hub == ROUTER:
            self._networks[host] = network
        self._in(hub, "link", "add", host, "type", "veth", "peer", "name", hub, "netns", self._name(host))
        for end, name, last in ((hub, host, 1), (host, hub, 2)):
            self._in(end, "address", "add", f"{network}.{last}/24", "dev", name)
            self._in(end, "link", "set", name, "up")
        self._in(host, "route", "add", f"{hub_address}/32", "via", f"{network}.1")

    def _in(self, host: str, *arguments: str) -> None:
        self._run("-netns", self._name(host), *arguments)

    def _run(self, *arguments: str) -> None:
        done = subprocess.run(["ip", *arguments], capture_output=True, text=True, check=False)
        if done.returncode:
            raise OSError(f"`ip {' '.join(arguments)}` says: {done.stderr.strip()}")

    def _name(self, host: str) -> str:
        return f"{self._prefix}-{host}"


class Loopback:
    """Everybody on 127.0.0.1; each process reaches the router through a proxy of its own."""

    kind = "loopback"
    truth_reaches = True
    world = "127.0.0.1"

    def __init__(self) -> None:
        self._proxies: Final[dict[str, Proxy]] = {}

    def command(self, host: str, arguments: Sequence[str]) -> list[str]:
        return list(arguments)

    def router(self) -> str:
        return "127.0.0.1:0"

    def reach_router(self, process: str, router: str) -> str:
        if process not in self._proxies:
            self._proxies[process] = Proxy(router)
        return self._proxies[process].address

    def connect(self, host: str, address: str) -> socket.socket:
        name, _, port = address.rpartition(":")
        return socket.create_connection((name, int(port)), 5.0)

    def cut(self, process: str) -> None:
        self._proxies[process].cut = True

    def heal(self, process: str) -> None:
        self._proxies[process].cut = False

    def close(self) -> None:
        for proxy in self._proxies.values():
            proxy.close()


class Proxy:
    """Passes bytes between whoever connects and a server. While it is cut nothing passes and nobody is told.

    Args:
        target: the server, as `host:port`.

    Attributes:
        address: where to connect instead.
        cut: whether it is cut.
    """

    def __init__(self, target: str) -> None:
        self.cut = False
        self._target: Final = target
        self._listener: Final = socket.create_server(("127.0.0.1", 0))
        self._listener.settimeout(0.1)
        self.address: Final = f"127.0.0.1:{self._listener.getsockname()[1]}"
        self._selector: Final = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._done: Final = threading.Event()
        self._thread: Final = threading.Thread(target=self._serve, name="proxy", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End it, and all that passes through it. Idempotent."""
        self._done.set()
        self._thread.join()

    def _serve(self) -> None:
        while not self._done.is_set():
            if self.cut:
                # What has been sent meanwhile lies in the sockets' buffers, as on a host behind a pulled cable.
                self._done.wait(0.01)
                continue
            for key, _ in self._selector.select(0.05):
                if key.fileobj is self._listener:
                    self._accept()
                else:
                    self._pass(key)
        for key in [*self._selector.get_map().values()]:
            key.fileobj.close()  # type: ignore[union-attr] # all of them are sockets
        self._selector.close()

    def _accept(self) -> None:
        client, _ = self._listener.accept()
        host, _, port = self._target.rpartition(":")
        try:
            server = socket.create_connection((host, int(port)), 5.0)
        except OSError:
            client.close()
            return
        for one, other in ((client, server), (server, client)):
            one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._selector.register(one, selectors.EVENT_READ, other)

    def _pass(self, key: selectors.SelectorKey) -> None:
        source, sink = key.fileobj, key.data
        assert isinstance(source, socket.socket)
        assert isinstance(sink, socket.socket)
        if source.fileno() < 0:
            # Closed with the other of its pair, a moment ago.
            return
        try:
            data = source.recv(_CHUNK)
            if data:
                sink.sendall(data)
                return
        except OSError:
            # Either end is gone, and with it what they said to each other.
            pass
        for each in (source, sink):
            self._selector.unregister(each)
            each.close()


def make_hosts(where: str, robots: Sequence[str], others: Sequence[str]) -> Hosts:
    """Return hosts: `namespaces`, `loopback`, or with `auto` the former where they are permitted.

    Raises:
        OSError: namespaces were asked for and are not permitted.
    """
    if where == "loopback":
        return Loopback()
    try:
        return Namespaces(robots, others)
    except OSError:
        if where == "namespaces":
            raise
        return Loopback()
