"""What becomes of handlers that wait when a runtime is closed or a machine fails."""

import pytest

from soter.machine import (
    HandlerError,
    MisuseError,
    State,
)
from tests.machine.helpers import A, B, C, Logger, feed, start


class Closing(Logger):
    S = State(start=True)

    @S.on(A)
    async def _a(self) -> None:
        try:
            await self.receive(B)
        finally:
            self.send(self.ref, C())
            self.log.append("closed")

    @S.on(B)
    async def _b(self) -> None:
        try:
            await self.receive(B)
        finally:
            self.log.append("raises")
            raise RuntimeError("no")


def test_close_ends_the_waiting_handlers() -> None:
    log: list[object] = []
    made, ref = start(Closing, log=log)
    made.call_at(9.0, ref, A())
    feed(made, ref, A())
    made.close()
    made.close()
    assert log == ["closed"]
    assert made.next_timer_s is None
    made.post(ref, A())
    assert made.run() == 0
    made.create(Closing)
    with pytest.raises(MisuseError, match=r"run\(\) after close\(\)"):
        made.run()


def test_close_closes_all_and_reports_the_first_failure() -> None:
    log: list[object] = []
    made, first = start(Closing, log=log)
    second = made.create(Closing, log=log)
    feed(made, first, B())
    feed(made, second, A())
    with pytest.raises(HandlerError, match="while being abandoned, raised RuntimeError: no"):
        made.close()
    assert log == ["raises", "closed"]


def test_a_failure_closes_a_waiting_handler_quietly() -> None:
    class Bad(Logger):
        S = State(start=True)

        @S.entry
        async def _enter(self) -> None:
            try:
                await self.receive(A, match=lambda a: 1 / 0 > 0)
            finally:
                self.log.append("closed")
                raise RuntimeError("hidden by the first failure")

    log: list[object] = []
    made, ref = start(Bad, log=log)
    made.post(ref, A())
    with pytest.raises(HandlerError, match="ZeroDivisionError"):
        made.run()
    assert log == ["closed"]
