"""What a subclass takes over from its base, and what a class may share."""

import pytest

from soter.machine import Event, Goto, Machine, MachineDefinitionError, MisuseError, Next, Spec, State, Stay
from tests.machine.helpers import A, B, C, Logger, Num, feed, runtime, start


class Base(Logger):
    S = State(start=True, ignore=(C,))
    T = State()

    @S.on(A)
    def _a(self, e: A) -> Next:
        self.log.append("base a")
        return Stay()

    @S.on(B)
    def _b(self, e: B) -> None:
        self.log.append("base b")

    @S.entry
    def _enter(self) -> None:
        self.log.append("base entry")


class Sub(Base):
    U = State()
    Base.S.on(Num, goto=U)

    def _a(self, e: A) -> Next:
        self.log.append("sub a")
        return super()._a(e)

    @Base.S.on(B)
    def _other_b(self, e: B) -> None:
        self.log.append("sub b")

    @Base.S.on(C)
    def _c(self) -> None:
        self.log.append("sub c")

    @U.entry
    def _u(self, e: Num) -> None:
        self.log.append(e)


def test_a_subclass_overrides_by_method_name_and_by_event_and_adds_states() -> None:
    log: list[object] = []
    made, ref = start(Sub, log=log)
    feed(made, ref, A(), B(), C(), Num(1))
    assert log == ["base entry", "sub a", "base a", "sub b", "sub c", Num(1)]


def test_the_base_class_is_left_as_it_was() -> None:
    log: list[object] = []
    made, ref = start(Base, log=log)
    feed(made, ref, A(), B(), C())
    assert log == ["base entry", "base a", "base b"]


def test_a_class_that_was_refused_leaves_nothing_behind_in_its_base() -> None:
    with pytest.raises(MachineDefinitionError):

        class Wrong(Base):
            @Base.S.on(Num)  # type: ignore[arg-type]
            def _x(self, a: int, b: int) -> None: ...

    class Fine(Base):
        @Base.S.on(Num)
        def _x(self, e: Num) -> None:
            self.log.append(e)

    log: list[object] = []
    made, ref = start(Fine, log=log)
    feed(made, ref, Num(1))
    assert log[-1] == Num(1)


class Template(Machine, abstract=True):
    Work = State()

    @Work.entry
    def _work(self) -> None: ...


class Concrete(Template):
    Begin = State(start=True)
    Begin.on(Event, goto=Template.Work)


def test_an_abstract_class_has_no_start_state_and_its_subclass_one() -> None:
    made = runtime()
    with pytest.raises(MisuseError, match="Template has no start state; create a subclass that has one"):
        made.create(Template)
    made, ref = start(Concrete)
    feed(made, ref, A())
    assert made.state(ref) == "Work"


def test_an_abstract_spec_cannot_be_used() -> None:
    class Watch(Spec, abstract=True, observes=(A,)):
        S = State()

    with pytest.raises(MisuseError, match="Watch has no start state and cannot be used; use a subclass of it"):
        runtime().monitor(Watch)


def test_only_machine_classes_are_created() -> None:
    with pytest.raises(MisuseError, match="takes a machine class, not"):
        runtime().create(int)  # type: ignore[arg-type]


def test_one_method_may_serve_several_states() -> None:
    class Shared(Logger):
        S = State(start=True)
        T = State()

        @S.on(A)
        @T.on(A)
        def _a(self) -> Next:
            self.log.append("a")
            return Goto(self.T)

    log: list[object] = []
    made, ref = start(Shared, log=log)
    feed(made, ref, A(), A())
    assert log == ["a", "a"]


def test_a_decorator_object_that_is_used_twice_is_a_duplicate() -> None:
    with pytest.raises(MachineDefinitionError, match="already says what to do with A"):

        class Twice(Machine):
            S = State(start=True)
            on_a = S.on(A)

            @on_a
            def _a(self) -> None: ...

            @on_a
            def _b(self) -> None: ...
