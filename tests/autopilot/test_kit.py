"""The whole conformance kit with real autopilots, in their own simulator, two at a time: `make test-autopilot`.

Every clause passes, or is one of those that are impossible on such a vehicle, which docs/mavlink.md names. The
environment variable AUTOPILOT_PAIRS says how many pairs are tried side by side, AUTOPILOT_CLAUSES which of the kit.
What fails beside others is tried once more alone, with all verdicts printed: figures of a wall clock hold what others
cost.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Final

import pytest

from soter.conformance import select
from tests.autopilot import test_arducopter, test_ardurover
from tests.autopilot.impossible import IMPOSSIBLE
from tests.autopilot.kit import GIVEN, PairHarness
from tests.autopilot.missions import Example

PAIRS: Final = int(os.environ.get("AUTOPILOT_PAIRS", "3"))
CLAUSES: Final = os.environ.get("AUTOPILOT_CLAUSES", "").split()
KINDS: Final = {
    "rover": (test_ardurover.PROGRAM, test_ardurover.ROVER, 12.0),
    "copter": (test_arducopter.PROGRAM, test_arducopter.COPTER, 20.0),
}
LIMIT_S: Final = 3 * 3600.0


def judged(
    example: Example, program: str, room_m: float, folder: Path, clauses: Sequence[str], side_by_side: int
) -> dict[str, tuple[str, str]]:
    """Let `soter conform` try clauses on pairs of vehicles; return each clause's verdict and reason."""
    folder.mkdir()
    record = folder / "record.json"
    with ExitStack() as started:
        pairs = []
        for number in range(side_by_side):
            pair = started.enter_context(example.start(program, folder / str(number), 2))
            connection, lock = f"udpin:127.0.0.1:{pair.port}", folder / f"{number}.lock"
            pairs.append({"connection": connection, "truth": pair.truth, "lock": str(lock)})
        given = {"mission": str(example.path), "room_m": room_m, "pairs": pairs}
        only = [word for clause in clauses for word in ("--only", clause)]
        subprocess.run(
            [sys.executable, "-m", "soter.cli", "conform", f"{PairHarness.__module__}:{PairHarness.__name__}",
             "--jobs", str(side_by_side), "--json", record, *only],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), GIVEN: json.dumps(given)}, check=False,
        )  # fmt: skip
    return {each["id"]: (each["verdict"], each["reason"]) for each in json.loads(record.read_text())["clauses"]}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.timeout(LIMIT_S)
def test_every_clause_passes_or_is_impossible_on_such_a_vehicle(kind: str, tmp_path: Path) -> None:
    program, example, room_m = KINDS[kind]
    if not program:
        pytest.skip("needs an ArduPilot; see `make test-autopilot`")
    found = judged(example, program, room_m, tmp_path / "first", CLAUSES, PAIRS)
    failed = [key for key, (verdict, _) in found.items() if verdict == "FAIL"]
    if failed and PAIRS > 1:
        alone = judged(example, program, room_m, tmp_path / "alone", failed, 1)
        found |= {key: alone[key] for key in failed}
    assert found.keys() == {each.id for each in select(CLAUSES)}
    assert {key: why for key, (verdict, why) in found.items() if verdict == "FAIL"} == {}
    untried = {key: why for key, (verdict, why) in found.items() if verdict == "NOT TESTED"}
    assert {key: why for key, why in untried.items() if key not in IMPOSSIBLE} == {}
    assert IMPOSSIBLE & found.keys() == untried.keys()
