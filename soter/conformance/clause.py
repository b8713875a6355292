"""A clause: one sentence that every adapter must keep, and the function that checks it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Final

from soter.conformance.bench import Bench


class Tier(Enum):
    """What a clause needs to be tried: nothing, the truth, or a wire to break."""

    CORE = "core"
    TRUTH = "truth"
    WIRE = "wire"


Check = Callable[[Bench], None]


@dataclass(frozen=True, slots=True)
class Clause:
    """One clause.

    Attributes:
        id: stable; `group.name`, with the prefix `truth.` if the truth judges instead of the robot's own state.
        contract: what every adapter must do, in one sentence.
        tier: what the clause needs.
        check: raises `Failed` if an adapter does not keep the contract.
        hooks: the optional hooks that the harness must give.
        needs: capabilities without which the clause does not apply.
    """

    id: str
    contract: str
    tier: Tier
    check: Check
    hooks: tuple[str, ...]
    needs: tuple[str, ...]

    @property
    def group(self) -> str:
        """The part of the id before the clause's own name."""
        return self.id.rpartition(".")[0]


CLAUSES: Final[dict[str, Clause]] = {}
"""Every clause by id, in the order in which the kit judges them."""


def clause(
    clause_id: str,
    *,
    tier: Tier = Tier.CORE,
    truth: bool = False,
    hooks: tuple[str, ...] = (),
    needs: tuple[str, ...] = (),
) -> Callable[[Check], Check]:
    """Register a check; the first line of its docstring is the contract.

    Args:
        clause_id: its id.
        tier: its tier.
        truth: register it a second time, to be judged by the truth.
        hooks: names from `soter.conformance.HOOKS`.
        needs: names of capabilities.
    """

    def register(check: Check) -> Check:
        contract = (check.__doc__ or "").partition("\n")[0]
        CLAUSES[clause_id] = Clause(clause_id, contract, tier, check, hooks, needs)
        if truth:
            twin = f"truth.{clause_id}"
            CLAUSES[twin] = Clause(twin, contract, Tier.TRUTH, check, hooks, needs)
        return check

    return register
