"""Skips the tests of a library that is not installed, and says at the top which libraries are."""

from __future__ import annotations

import functools
import gc
import importlib.util
import signal
from collections.abc import Iterator

import pytest
import typer.testing
from hypothesis import settings

# A test that fails today must fail tomorrow: the same examples in every run, however loaded the machine is.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")

# Hundreds of tests call commands: each call would build the whole command line anew.
typer.testing._get_command = functools.cache(typer.testing._get_command)  # type: ignore[attr-defined]

OPTIONAL_LIBRARIES = ("pybullet", "ompl", "rclpy")


def is_installed(library: str) -> bool:
    """Whether a library can be imported, without importing it."""
    return importlib.util.find_spec(library) is not None


_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@pytest.fixture
def own_signals() -> Iterator[None]:
    """For a test that runs a program's `main` in this process: what it makes of signals ends with the test."""
    before = {number: signal.getsignal(number) for number in _SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Blame a test that leaves signals to a handler of its own: another one would wait for Ctrl-C in vain."""
    before = {number: signal.getsignal(number) for number in _SIGNALS}
    result = yield
    for number, handler in before.items():
        left = signal.getsignal(number)
        assert left == handler, f"{item.nodeid} has left {number.name} to {left}"
    return result


def pytest_report_header() -> str:
    """One line on what will be skipped."""
    states = (f"{name} {'installed' if is_installed(name) else 'missing'}" for name in OPTIONAL_LIBRARIES)
    return "optional libraries: " + ", ".join(states)


def pytest_collection_finish() -> None:
    """What is collected stays until the end: the garbage collector need not go through it again and again."""
    gc.freeze()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip tests marked with the name of a library that is missing, and begin with the long ones.

    Otherwise one worker is left with them when all others are done.
    """
    items.sort(key=lambda item: item.get_closest_marker("long") is None)
    for item in items:
        if item.get_closest_marker("long") and not item.get_closest_marker("timeout"):
            item.add_marker(pytest.mark.timeout(360))
    for name in OPTIONAL_LIBRARIES:
        if is_installed(name):
            continue
        skip = pytest.mark.skip(reason=f"{name} is not installed")
        for item in items:
            if item.get_closest_marker(name):
                item.add_marker(skip)
