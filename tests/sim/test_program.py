"""What the programs of simulated worlds have in common."""

from __future__ import annotations

import math
import os
import sys
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from soter.config import load_mission
from soter.sdk import RobotSpec, RuleLimits
from soter.sdk.wire import describe
from soter_sim import program
from tests.sdk.fake import capabilities

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


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


def test_a_world_of_neither_kind_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    described = msgspec.msgpack.encode((None, None, (), RuleLimits()))
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=BytesIO(described)))
    with pytest.raises(ValueError, match="neither a room nor a site"):
        program.read_world()


@pytest.mark.parametrize("mission", ["surveillance.toml", "worlds/patrol.toml", "worlds/flat-patrol.toml"])
def test_a_world_is_read_as_it_was_described(mission: str, monkeypatch: pytest.MonkeyPatch) -> None:
    workspace = load_mission(EXAMPLES / mission).read_workspace()
    promised = capabilities(v_max_m_s=0.5)
    robots = tuple(
        RobotSpec(each.id, each.x_m, each.y_m, each.heading_rad, drive_s=math.inf, promised=promised)
        for each in workspace.robots
    )
    described = describe(workspace, robots, RuleLimits())
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=BytesIO(described)))
    assert program.read_world() == (workspace, robots, RuleLimits())
