"""Draws and runs many configurations; what is finished is kept, so that it can be stopped and carried on."""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import asdict
from pathlib import Path
from threading import Event
from typing import Any, Final

from tools.acceptance.store import source_hash
from tools.generator.drawing import draw
from tools.generator.running import LIMIT_S, Outcome, run_apart

RUNS_FILE: Final = "runs.jsonl"
WANTED_SHARE: Final = 0.6
"""At least this part of what is drawn has to be accepted: refusing everything is no way out."""


def state() -> str:
    """Return a hash over all that an outcome depends on: SOTER, its libraries, and this generator."""
    digest = hashlib.sha256(source_hash().encode())
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


class Campaign:
    """The runs of some seeds, one line each in a file.

    Args:
        folder: where the file is.
        engine: of the simulated robots.
        duration_s: in place of what is drawn, or None.
        limit_s: host time for one run.

    Attributes:
        outcomes: by seed, what is finished.
    """

    def __init__(
        self, folder: Path, engine: str = "kinematic", duration_s: float | None = None, limit_s: float = LIMIT_S
    ) -> None:
        self.folder: Final = folder
        self.engine: Final = engine
        self.duration_s: Final = duration_s
        self.limit_s: Final = limit_s
        self.outcomes: dict[int, Outcome] = {}
        # What was measured of other sources, or in another way, is something else.
        self._key: Final = f"{state()} {engine} {duration_s}"
        self._stop: Final = Event()
        folder.mkdir(parents=True, exist_ok=True)
        for line in self._lines():
            if line.get("key") == self._key:
                self.outcomes[line["seed"]] = Outcome(**line["outcome"])

    def _lines(self) -> Iterator[dict[str, Any]]:
        file = self.folder / RUNS_FILE
        for line in file.read_text(encoding="utf-8").splitlines() if file.exists() else ():
            try:
                yield json.loads(line)
            except ValueError:
                # The last line of a campaign that was killed.
                continue

    def run(self, seeds: Sequence[int], jobs: int, on_done: Callable[[int, Outcome], None]) -> None:
        """Run the seeds that are not finished, so many at a time; `on_done` is called in the caller's thread.

        Raises:
            KeyboardInterrupt: after Ctrl-C; what is finished is kept.
        """
        missing = iter([seed for seed in seeds if seed not in self.outcomes])
        with ThreadPoolExecutor(jobs) as pool, (self.folder / RUNS_FILE).open("a", encoding="utf-8") as file:
            waiting: dict[Future[Outcome], int] = {}

            def more() -> None:
                for seed in missing:
                    waiting[pool.submit(self._one, seed)] = seed
                    return

            try:
                for _ in range(jobs):
                    more()
                while waiting:
                    for future in wait(waiting, timeout=1.0, return_when=FIRST_COMPLETED).done:
                        seed, outcome = waiting.pop(future), future.result()
                        self.outcomes[seed] = outcome
                        line = {"seed": seed, "key": self._key, "outcome": asdict(outcome)}
                        file.write(json.dumps(line) + "\n")
                        file.flush()
                        on_done(seed, outcome)
                        more()
            finally:
                self._stop.set()

    def _one(self, seed: int) -> Outcome:
        with tempfile.TemporaryDirectory() as folder:
            mission = draw(seed, self.engine).write(Path(folder))
            return run_apart(mission, self.limit_s, self.duration_s, self._stop)


def summary(outcomes: dict[int, Outcome]) -> list[str]:
    """Return what a campaign found, as lines of text."""
    accepted = {seed: each for seed, each in outcomes.items() if each.status == "accepted"}
    refused = Counter(each.group for each in outcomes.values() if each.status == "refused")
    hours = sum(each.robots * each.duration_s for each in accepted.values()) / 3600.0
    share = len(accepted) / max(1, len(outcomes))
    lines = [
        f"drawn {len(outcomes)}, accepted {len(accepted)} ({share:.0%}), robot-hours {hours:.1f}",
        f"refused {refused.total()}",
        *(f"  {count:5d}  {group}" for group, count in refused.most_common()),
    ]
    if accepted:
        lines.append(f"AC in control {sum(each.ac_share for each in accepted.values()) / len(accepted):.1%} on average")
    by_kind: dict[str, list[int]] = {}
    for seed, each in sorted(outcomes.items()):
        for failure in each.failures:
            by_kind.setdefault(failure, []).append(seed)
        if each.never_moved:
            by_kind.setdefault("(robots that never moved)", []).append(seed)
        for name in each.assumptions:
            by_kind.setdefault(f"(assumption {name} failed)", []).append(seed)
    for kind, seeds in sorted(by_kind.items()):
        lines.append(f"{kind}: {len(seeds)} runs, seeds {' '.join(map(str, seeds))}")
    return lines


def verdict(outcomes: dict[int, Outcome]) -> list[str]:
    """Return what is wrong with a campaign's outcomes; nothing if all is well."""
    failing = sorted(seed for seed, each in outcomes.items() if each.failures)
    accepted = sum(each.status == "accepted" for each in outcomes.values())
    found = [f"{len(failing)} configurations fail: seeds {' '.join(map(str, failing))}"] if failing else []
    if outcomes and accepted < WANTED_SHARE * len(outcomes):
        found.append(f"{accepted} of {len(outcomes)} were accepted, wanted: at least {WANTED_SHARE:.0%}")
    return found
