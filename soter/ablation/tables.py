"""The tables of an ablation: one line for each variant, all its seeds together."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from soter.ablation.ablate import Variant, VariantRefusal, VariantRun
from soter.runner.result import RunResult
from soter.sdk import RULES

HEAD: Final = (
    "variant", f"violations ({' / '.join(RULES)})", "AC share", "disengagements per robot-hour", "least margins",
    "reached per robot-hour", "of AC only", "remark",
)  # fmt: skip

GROUPS: Final[Mapping[str, str]] = {
    "mission": "The mission as it is declared, without any decision module, and with safe controllers alone.",
    "without a module": "One module left out: nothing but the AC keeps its rule then. The other rules hold.",
    "Delta of": (
        "How often a module looks. `mission` is the mission's own machines, the others are adversaries. A variant is "
        "refused whose phi_safer lies within the reach bound: forced, it keeps the rule, because the AC gets control "
        "only where the margin is enough, but there is hardly such a place, and the AC's share is gone."
    ),
    "look-ahead": (
        "How many Delta the switching test looks ahead, besides the latency; the lease is left out of account. Proofs "
        "need 2, of which a safe controller may take one to act. These act in the tick of the decision, so that 1 "
        "still holds here, with less distance kept; less than 1 does not."
    ),
    "phi_safer alone": (
        "A module gives back where its margin is at least the reach bound AND phi_safer holds. The first is no more "
        "than P3 asks of phi_safer, so that a well-formed module does not need it. Here it is left out: the AC gets "
        "control wherever phi_safer holds, and P3 is all that stands between an adversary and the rule."
    ),
    "phi_safer of": (
        "Where control may go back to the AC. The nearer to the edge, the less time is lost, and the sooner the AC is "
        "disengaged again; nearer than the reach bound is refused."
    ),
    "dwell": "How long a robot must have been in phi_safer, all modules alike.",
    "adversary": "Whatever the AC is, no rule breaks. Adversaries are given no targets, and reach none.",
}
"""The text above a group's table, by the beginning of the group's name."""

_FIGURES: Final = (
    "Violations and least margins are those of ground truth: a charge from 0 to 1, then metres. Throughput is compared "
    "with that of the AC alone, which breaks rules, and whose robots end with flat batteries."
)


@dataclass(frozen=True)
class VariantRow:
    """All runs of one variant, one for each seed."""

    variant: Variant
    outcomes: Sequence[VariantRun]

    @property
    def results(self) -> list[RunResult]:
        """The results of the runs that were made, also of those that were stopped."""
        return [outcome.result for outcome in self.outcomes if outcome.result is not None]

    @property
    def reached_per_hour(self) -> float | None:
        """Targets reached per robot-hour; None if nothing was run."""
        return _per_hour(self.results, [result.targets_reached for result in self.results])

    @property
    def refusal(self) -> VariantRefusal | None:
        """Why the variant is ill-formed; None if it is not."""
        return next((outcome.refusal for outcome in self.outcomes if outcome.refusal is not None), None)

    @property
    def mark(self) -> str:
        """What was done with an ill-formed variant, such as `refused (P3)`; empty for a well-formed one."""
        if self.refusal is None:
            return ""
        done = "forced" if self.results else "refused"
        return f"{done} ({self.refusal.condition})" if self.refusal.condition else done

    def cells(self, ac_only: float | None) -> list[str]:
        """Return the table's line; `ac_only` is the throughput of the AC alone, to compare with."""
        results, remark = self.results, self._remark()
        if not results:
            return [self.variant.name, *[""] * (len(HEAD) - 2), remark]
        violations = [sum((r.violations or {}).get(rule, 0) for r in results) for rule in RULES]
        margins = [min((m for r in results if (m := (r.min_margin or {}).get(rule)) is not None), default=None)
                   for rule in RULES]  # fmt: skip
        disengaged = _per_hour(results, [r.disengagements_total for r in results]) or 0.0
        reached = self.reached_per_hour or 0.0
        return [
            self.variant.name,
            " / ".join([*map(str, violations), *self._own_violations()]),
            f"{sum(r.ac_share for r in results) / len(results):.1%}",
            f"{disengaged:.0f}",
            " / ".join("-" if margin is None else f"{margin:.3f}" for margin in margins),
            f"{reached:.0f}",
            f"{reached / ac_only:.0%}" if ac_only else "-",
            remark,
        ]

    def _own_violations(self) -> list[str]:
        """Return the violations of user-made rules, with their names, since the table's head lacks these."""
        names = dict.fromkeys(rule for r in self.results for rule in r.violations or () if rule not in RULES)
        return [f"{name} {sum((r.violations or {}).get(name, 0) for r in self.results)}" for name in names]

    def _remark(self) -> str:
        failure = next((outcome.failure for outcome in self.outcomes if outcome.failure), "")
        if failure:
            return f"FAILED: {failure}"
        if self.refusal is not None:
            return f"{self.mark}: {self.refusal.remedy}"
        return "BREAKS ITS PROMISE" if any(outcome.breaks_promise for outcome in self.outcomes) else ""


def _per_hour(results: Sequence[RunResult], counts: Sequence[int]) -> float | None:
    hours = sum(result.duration_s * result.robots for result in results) / 3600.0
    return sum(counts) / hours if hours else None


def rows(outcomes: Iterable[VariantRun], order: Sequence[Variant]) -> list[VariantRow]:
    """Return a row for every variant that has an outcome, in the order given."""
    by_variant: dict[str, list[VariantRun]] = {}
    for outcome in outcomes:
        by_variant.setdefault(_key(outcome.variant), []).append(outcome)
    return [
        VariantRow(variant, sorted(found, key=lambda outcome: outcome.seed))
        for variant in order
        if (found := by_variant.get(_key(variant)))
    ]


def _key(variant: Variant) -> str:
    return f"{variant.group}/{variant.name}"


def ac_only(found: Sequence[VariantRow]) -> float | None:
    """Return the throughput of the mission without decision modules; None if it was not run."""
    return next((row.reached_per_hour for row in found if row.variant.overrides == {"rta.enabled": False}), None)


def markdown(found: Sequence[VariantRow], command: str) -> str:
    """Return the page of an ablation."""
    results = [result for row in found for result in row.results]
    seeds = sorted({outcome.seed for row in found for outcome in row.outcomes})
    first = results[0] if results else None
    about = (
        f"Each line: seeds {', '.join(map(str, seeds))}, {first.duration_s / 60.0:g} simulated minutes each, "
        f"{first.robots} robots, `{first.targets_from}` targets, backend `{first.backend}`."
        if first
        else "Nothing was run."
    )
    lines = [
        "# Ablation", "",
        "This page shows the worth of each part of the safety modules, with one thing changed at a time.",
        "Its tables come from", "",
        "```sh", command, "```", "",
        f"{about} {_FIGURES}",
    ]  # fmt: skip
    compared, group = ac_only(found), ""
    for row in found:
        if row.variant.group != group:
            group = row.variant.group
            text = next((text for name, text in GROUPS.items() if group.startswith(name)), "")
            lines += ["", f"## {group[0].upper()}{group[1:]}", "", text, ""]
            lines += [f"| {' | '.join(HEAD)} |", f"| --- | {'--: | ' * (len(HEAD) - 2)}--- |"]
        lines.append(f"| {' | '.join(cell.replace('|', '/') for cell in row.cells(compared))} |")
    return "\n".join(lines) + "\n"
