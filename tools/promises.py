"""Writes the table of what adapters promise beside what was measured of it, from records of the conformance kit.

```
soter conform zmq --jobs 1 --json zmq.json
python -m tools.promises zmq.json lcm.json
```

writes it into docs/conformance.md, in place of what stands there of these adapters; what is there of others stays. Of
each promise it shows the worst figure that a clause has judged, by truth where truth has, and the least, median and
largest trial behind it. A figure that comes within half of its promise needs a reason; one without is an error.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from soter.sdk.capabilities import WIDENS, Widens

PAGE: Final = Path(__file__).parents[1] / "docs" / "conformance.md"
BEGIN: Final = "<!-- measured -->"
END: Final = "<!-- end of measured -->"
TIMES: Final = 2.0
"""So many times worse than what was measured a promise is, unless it has a reason."""

HEAD: Final = (
    "| adapter | promise | promised | measured | least, median, largest | times | by |\n|---|---|--:|--:|---|--:|---|"
)

REASONS: Final[Mapping[str, str]] = {
    "v_max_m_s": "the robot clamps it",
    "yaw_rate_max_rad_s": "the robot clamps it",
    "accel_m_s2": "the robot's motors are set to it",
    "brake_m_s2": "the robot's motors are set to it",
    "body_radius_m": "a length, which neither load nor luck changes",
    "lease_s": "the robot counts it itself, and a period less",
    "setpoint_period_s": "the robot's own period, which begins at any moment",
    "position_noise_m": "places are exact or come in whole millimetres; the rest is how well clocks agree",
    "latency_s": "in virtual time a command acts in the next period, never later",
}
"""By promise, why it may be near to what was measured. That of latencies holds in virtual time only."""


class Row(NamedTuple):
    """One promise of one adapter.

    Attributes:
        adapter: the harness's name.
        name: of the capability.
        promised: what is declared.
        worst: figure that was judged.
        off: how far that may be off.
        spread: least, median and largest of the trials, where there were several.
        times: how many times better what was measured is than what is promised.
        clause: that measured it.
        in_process: whether the robots live in virtual time.
    """

    adapter: str
    name: str
    promised: float
    worst: float
    off: float
    spread: Sequence[float]
    times: float
    clause: str
    in_process: bool

    @property
    def reason(self) -> str:
        """Why the promise may be near to what was measured; empty where there is no such reason."""
        if self.name == "latency_s" and not self.in_process:
            return ""
        return REASONS.get(self.name, "")


def rows_of(record: Mapping[str, Any]) -> Iterator[Row]:
    """Yield what a record says of each promise that it has measured."""
    subject = record["subject"]
    for name, promised in subject["capabilities"].items():
        if promised is None or isinstance(promised, bool):
            continue
        found = [
            (clause["id"], figure)
            for clause in record["clauses"]
            for figure in clause["figures"]
            if figure["name"] == name
        ]
        # Who has seen it from outside knows better than the robot.
        found = [each for each in found if each[0].startswith("truth.")] or found
        rows = [_row(record["adapter"], promised, clause, figure, subject["in_process"]) for clause, figure in found]
        if rows:
            yield min(rows, key=lambda row: row.times)


def _row(adapter: str, promised: float, clause: str, figure: Mapping[str, Any], in_process: bool) -> Row:
    name, worst = figure["name"], figure["value"]
    part, whole = (worst, promised) if WIDENS[name] is Widens.DOWN else (promised, worst)
    times = part / whole if whole else math.inf
    return Row(adapter, name, promised, worst, figure["resolution"], figure["spread"], times, clause, in_process)


def table(rows: Iterable[Row], others: Sequence[str] = ()) -> str:
    """Return the table.

    Args:
        rows: of it.
        others: lines that stand in it already and stay.

    Raises:
        ValueError: a promise is too near to what was measured, without a reason.
    """
    # By number the same in every table, so that lines of an older one stay right.
    notes = {reason: number for number, reason in enumerate(dict.fromkeys(REASONS.values()), start=1)}
    lines = [HEAD, *others]
    for row in rows:
        note = ""
        if row.times < TIMES:
            if not row.reason:
                raise ValueError(
                    f"{row.adapter}: {row.name} is promised as {row.promised:g}, and {row.worst:.3g} was measured by "
                    f"{row.clause}: promise less, or say in REASONS why that is enough"
                )
            note = f" [{notes[row.reason]}]"
        times = "exact" if math.isinf(row.times) else f"{row.times:.2g}{note}"
        off = f" ± {row.off:.2g}" if row.off else ""
        lines.append(
            f"| {row.adapter} | `{row.name}` | {row.promised:g} | {row.worst:.3g}{off} | "
            f"{', '.join(f'{each:.3g}' for each in row.spread)} | {times} | `{row.clause}` |"
        )
    used = {number: reason for reason, number in notes.items() if any(f" [{number}] |" in line for line in lines)}
    said = "; ".join(f"[{number}] {reason}" for number, reason in used.items())
    return "\n".join([*lines, *(["", f"Near for a reason: {said}."] if said else [])])


def main(files: Sequence[str]) -> None:
    """Write the table of these records into the page."""
    records = [json.loads(Path(each).read_text(encoding="utf-8")) for each in files]
    page = PAGE.read_text(encoding="utf-8")
    (before, _, rest), after = page.partition(BEGIN), page.partition(END)[2]
    anew = tuple(f"| {record['adapter']} |" for record in records)
    stood = rest.partition(END)[0].splitlines()
    others = [line for line in stood if "` |" in line and not line.startswith(anew)]
    said = table((row for record in records for row in rows_of(record)), others)
    PAGE.write_text(f"{before}{BEGIN}\n\n{said}\n\n{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
