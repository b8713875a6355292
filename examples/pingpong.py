"""The PingPong program of the thesis: a client pings two servers and waits for a pong from each.

Run it with ``python examples/pingpong.py``; it prints every change of state.
"""

from __future__ import annotations

from dataclasses import dataclass

from soter.machine import Event, Halt, Machine, MachineRef, Next, Raise, Runtime, State, Transition


@dataclass(frozen=True, slots=True)
class Ping(Event):
    """Asks for a pong."""

    reply_to: MachineRef


@dataclass(frozen=True, slots=True)
class Pong(Event):
    """Answers a ping."""

    sender: MachineRef


class Success(Event):
    """A machine has done what its state is for."""


class Client(Machine):
    """Pings two servers and waits for both answers."""

    Init = State(start=True)
    SendPing = State()
    WaitPong1 = State()
    WaitPong2 = State()
    Done = State()

    Init.on(Success, goto=SendPing)
    SendPing.on(Success, goto=WaitPong1)
    WaitPong1.on(Pong, goto=WaitPong2)
    WaitPong2.on(Pong, goto=Done)

    @Init.entry
    def _remember(self, servers: tuple[MachineRef, MachineRef]) -> Next:
        self.servers = servers
        return Raise(Success())

    @SendPing.entry
    def _ping(self) -> Next:
        for server in self.servers:
            self.send(server, Ping(self.ref))
        return Raise(Success())


class Server(Machine):
    """Answers one ping, then stops."""

    Init = State(start=True)
    SendPong: State[Ping] = State()
    End = State()

    Init.on(Ping, goto=SendPong)
    SendPong.on(Success, goto=End)

    @SendPong.entry
    def _pong(self, ping: Ping) -> Next:
        self.send(ping.reply_to, Pong(self.ref))
        return Raise(Success())

    @End.entry
    def _stop(self) -> Next:
        return Halt()


class Driver(Machine):
    """Sets the program up."""

    Init = State(start=True)

    @Init.entry
    def _create(self) -> None:
        first = self.create(Server)
        second = self.create(Server)
        self.create(Client, (first, second))


def run() -> list[Transition]:
    """Run the program to its end and return what happened."""
    runtime = Runtime(now=lambda: 0.0)
    transitions: list[Transition] = []
    runtime.observe(transitions.append)
    runtime.create(Driver)
    runtime.run()
    return transitions


if __name__ == "__main__":
    for transition in run():
        event = "" if transition.event is None else f"  ({type(transition.event).__name__})"
        print(f"{transition.machine!s:10} {transition.source or '-':>10} -> {transition.target or '-'}{event}")
