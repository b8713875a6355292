"""Without postponed annotations, as a user may write machines."""

from typing import Optional

import pytest

from soter.machine import HandlerError, MachineError, MisuseError, Next, State
from tests.machine.helpers import A, B, C, Logger, feed, runtime, start


class Evaluated(Logger):
    S = State(start=True)

    @S.on(A)
    def _a(self, e: A) -> None:
        self.log.append("a")

    @S.on(B)
    def _b(self, e: B) -> Optional[Next]:  # noqa: UP045 - this spelling is meant
        self.log.append("b")
        return None

    @S.on(C)
    def _c(self, e: C) -> Next:
        return None  # type: ignore[return-value]


def test_what_a_handler_may_return_is_read_from_evaluated_annotations_too() -> None:
    log: list[object] = []
    made, ref = start(Evaluated, log=log)
    feed(made, ref, A(), B())
    assert log == ["a", "b"]
    made.post(ref, C())
    with pytest.raises(HandlerError, match="returned None although it is declared to return something else"):
        made.run()


def test_nobody_runs_the_runtime_while_it_is_running() -> None:
    def rerun(error: MachineError) -> None:
        made.run()

    made = runtime(on_failure=rerun)
    ref = made.create(Evaluated)
    made.post(ref, C())
    with pytest.raises(MisuseError, match=r"run\(\) was called while it is running"):
        made.run()
    assert made.run() == 0
