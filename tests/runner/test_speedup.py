"""A run that is ill-formed at its speed-up is refused with the highest one that would do."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import pytest

from soter.adapters.pybullet import KinematicBackend
from soter.adapters.pybullet.backend import KinematicConfig
from soter.check.admission import highest_speedup
from soter.config import load_mission
from soter.errors import IllFormedModule
from soter.runner import run_mission
from soter.sdk import BackendConfig, Capabilities
from soter.specs import read_options
from tests.project.source import ROOT

MISSION = ROOT / "examples" / "surveillance.toml"


class HastyConfig(KinematicConfig):
    speedup: float = 1.0


class HastyBackend(KinematicBackend):
    """Robots whose host is late by the same time however fast their world runs."""

    config_model: ClassVar[type[BackendConfig]] = HastyConfig

    @classmethod
    def promises(cls, config: Any) -> Capabilities:
        declared = cls.robot_class.declared
        return replace(declared, latency_s=declared.latency_s * config.speedup)


class LateBackend(HastyBackend):
    """Robots that are too late at any speed-up that is told."""

    @classmethod
    def promises(cls, config: Any) -> Capabilities:
        return replace(cls.robot_class.declared, latency_s=10.0)


def mission(backend: type[HastyBackend], speedup: float, **overrides: Any) -> Any:
    name = f"{__name__}:{backend.__name__}"
    return load_mission(MISSION, {"backend": name, "backends": {name: {"speedup": speedup}}, **overrides})


def test_the_highest_speedup_is_where_the_horizon_is_used_up() -> None:
    asked = mission(HastyBackend, 20.0, **{"rta.collision.delta_s": 0.1, "rta.collision.phi_safer_m": 0.5})
    workspace = asked.read_workspace()
    found = highest_speedup(asked, workspace, HastyBackend, read_options(HastyBackend, asked, workspace), 20.0)
    # The collision module's phi_safer leaves 0.2 m: 2 (0.22 (0.2 + L) + 0.0242) m, with L of 0.05 s times the speed-up.
    assert found == pytest.approx(((0.1 - 0.0242) / 0.22 - 0.2) / 0.05, abs=1e-3)


def test_where_no_speedup_would_do_none_is_named() -> None:
    asked = mission(LateBackend, 2.0)
    workspace = asked.read_workspace()
    config = read_options(LateBackend, asked, workspace)
    assert highest_speedup(asked, workspace, LateBackend, config, 2.0) is None


def test_a_run_is_refused_with_a_speedup_that_would_do(tmp_path: Path) -> None:
    # The robots really are as late as that: the module is refused for what they promise after they are ready.
    overrides = {"rta": {"collision": {"phi_safer_m": 0.45}}, "duration_s": 1.0}
    with pytest.raises(IllFormedModule, match=r"P3.*or backends\..*speedup = ([\d.]+), not 3") as refused:
        run_mission(mission(HastyBackend, 3.0, **overrides))
    fits = re.search(r"speedup = ([\d.]+), not 3", str(refused.value))
    assert fits is not None
    assert 0.0 < float(fits[1]) < 3.0
