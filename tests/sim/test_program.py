"""What the programs of simulated worlds have in common."""

from __future__ import annotations

import os
import sys
from types import SimpleNamespace
from typing import Any

import pytest

from soter_sim import program


def test_a_world_whose_starter_is_gone_ends_without_a_word(monkeypatch: pytest.MonkeyPatch) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    did: list[str] = []
    endpoint: Any = SimpleNamespace(
        truth=SimpleNamespace(address="127.0.0.1:1"),
        run=lambda _: did.append("ran"),
        close=lambda: did.append("closed"),
    )
    ended: Any = None
    monkeypatch.setattr(program, "_favour", lambda: None)
    with os.fdopen(writer, "w") as stdout:
        monkeypatch.setattr(sys, "stdout", stdout)
        program.serve(endpoint, ended)
    assert did == ["ran", "closed"]
