"""Campaigns for tests: short ones, and workers that carry runs out in this process."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Any

from soter.campaign.job import Done, Job, carry_out
from soter.campaign.plan import Campaign, load_campaign
from soter.config.toml_text import toml
from tests.project.source import ROOT

MISSION = str(ROOT / "examples" / "surveillance.toml")
QUICK = {"backend": "kinematic", "planner": "straight-line", "duration_s": 2.0}


class Here:
    """Carries runs out as soon as they are submitted, in this process."""

    died: tuple[type[BaseException], ...] = ()

    def __init__(
        self, count: int = 1, carry: Callable[[Job], Done] = lambda job: carry_out(job, lambda: False)
    ) -> None:
        self.count = count
        self.carried: list[Job] = []
        self._carry = carry

    def __enter__(self) -> Here:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def submit(self, job: Job) -> Future[Done]:
        self.carried.append(job)
        future: Future[Done] = Future()
        future.set_result(self._carry(job))
        return future


def write(folder: Path, *parts: dict[str, Any], **shared: Any) -> Path:
    """Write a campaign file of these parts."""
    path = folder / "campaign.toml"
    named = [{"name": f"p{index}", **part} for index, part in enumerate(parts or ({},))]
    path.write_text(toml({"mission": MISSION, "set": QUICK, **shared, "part": named}), encoding="utf-8")
    return path


def campaign(folder: Path, *parts: dict[str, Any], **shared: Any) -> Campaign:
    """Read a campaign of these parts."""
    return load_campaign(write(folder, *parts, **shared))
