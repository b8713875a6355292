"""Exact intervals, and the evidence of a stopping rule. From scipy, which has the special functions.

Quantiles are those functions and not `scipy.stats`, whose import alone takes every process nearly half a second.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from statistics import fmean, stdev
from typing import Final

from scipy.special import (
    bdtr,
    betainc,
    betaincinv,
    betaln,
    gammainc,
    gammainccinv,
    gammaincinv,
    gammaln,
    stdtrit,
)

LEVEL: Final = 0.95
"""How often an interval holds the true value, at least."""

_TAIL: Final = (1.0 - LEVEL) / 2.0


def poisson(count: int, exposure: float) -> tuple[float, float]:
    """Return the exact two-sided interval of a rate (Garwood 1936).

    Args:
        count: events, which come independently of each other.
        exposure: hours, for example; the interval is per such.
    """
    if exposure <= 0.0:
        return 0.0, math.inf
    low = float(gammaincinv(count, _TAIL)) if count else 0.0
    return low / exposure, float(gammainccinv(count + 1, _TAIL)) / exposure


def poisson_most(count: int, exposure: float) -> float:
    """Return the exact upper bound of a rate: for no event in T hours at 95 %, about 3/T."""
    return float(gammaincinv(count + 1, LEVEL)) / exposure if exposure > 0.0 else math.inf


def proportion(count: int, of: int) -> tuple[float, float]:
    """Return the exact two-sided interval of a share (Clopper and Pearson 1934)."""
    low = float(betaincinv(count, of - count + 1, _TAIL)) if count else 0.0
    high = float(betaincinv(count + 1, of - count, 1.0 - _TAIL)) if count < of else 1.0
    return low, high


def median(values: Sequence[float]) -> tuple[float, float, float] | None:
    """Return the median and its exact interval between two of the values, whatever the distribution.

    The k-th least and the k-th greatest of n values enclose the median unless fewer than k lie on one side of it, which
    is a matter of n fair coins. None where even the least and the greatest are too few: below 6 values at 95 %.
    """
    ordered, count = sorted(values), len(values)
    # The largest k with P(fewer than k on one side) <= tail.
    inside = bisect_right(range(count), _TAIL, key=lambda fewer: float(bdtr(fewer, count, 0.5)))
    if not inside:
        return None
    middle = (ordered[(count - 1) // 2] + ordered[count // 2]) / 2.0
    return middle, ordered[inside - 1], ordered[count - inside]


def positive_mean(values: Sequence[float]) -> tuple[float, float, float]:
    """Return the mean and an interval of values that cannot be negative and lie apart by factors, at least two of them.

    It is Student's interval of the mean, laid around its logarithm (by the delta method): it holds as far as that of
    many such values is a normal one. Around the mean itself it would too often end below the true value.
    """
    middle = fmean(values)
    if middle == 0.0:
        return 0.0, 0.0, math.inf
    error = stdev(values) / math.sqrt(len(values))
    factor = math.exp(float(stdtrit(len(values) - 1, 1.0 - _TAIL)) * error / middle)
    return middle, middle / factor, middle * factor


def rate_evidence(count: int, exposure: float, bound: float) -> float:
    """Return the evidence, after so many events, that a rate is below a bound; see `enough`.

    It is a likelihood ratio to the bound, mixed over rates below it: half of the weight on none at all, half spread
    evenly from 0 to the bound. While the true rate is the bound or more, its expectation never grows, so that by
    Ville's inequality it ever exceeds 1/a, however often one looks, with a probability of at most a.

    Returns:
        Its natural logarithm.
    """
    x = bound * exposure
    if x == 0.0:
        return 0.0
    spread = x + float(gammaln(count + 1)) - (count + 1) * math.log(x) + _log(float(gammainc(count + 1, x)))
    return _half(x if count == 0 else -math.inf, spread)


def share_evidence(count: int, of: int, bound: float) -> float:
    """Return the same for the share of runs that had an event, each with the same probability."""
    rest = of - count
    at_bound = count * math.log(bound) + rest * math.log1p(-bound)
    spread = float(betaln(count + 1, rest + 1)) + _log(float(betainc(count + 1, rest + 1, bound))) - math.log(bound)
    return _half(0.0 if count == 0 else -math.inf, spread) - at_bound


def enough(log_evidence: float, level: float) -> bool:
    """Return whether evidence is enough at a level, looked at again and again."""
    return log_evidence >= -math.log1p(-level)


def _half(first: float, second: float) -> float:
    most = max(first, second)
    return most + math.log((math.exp(first - most) + math.exp(second - most)) / 2.0)


def _log(value: float) -> float:
    return math.log(value) if value > 0.0 else -math.inf
