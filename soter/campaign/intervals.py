"""Exact intervals, and the evidence of a stopping rule, with scipy's special functions.

`scipy.stats` has the quantiles as well, but its import alone takes every process nearly half a second.
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
"""Least probability that an interval contains the true value."""

_TAIL: Final = (1.0 - LEVEL) / 2.0


def poisson(count: int, exposure: float) -> tuple[float, float]:
    """Return the exact two-sided interval of a rate (Garwood 1936).

    Args:
        count: the number of independent events.
        exposure: for example hours; the interval is per unit of it.
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
    has the probability of n fair coins. None if even the least and the greatest do not suffice: below 6 values at 95 %.
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

    The interval is Student's, around the logarithm of the mean (by the delta method): it holds as far as that logarithm
    is normally distributed. Around the mean itself it would too often end below the true value.
    """
    middle = fmean(values)
    if middle == 0.0:
        return 0.0, 0.0, math.inf
    error = stdev(values) / math.sqrt(len(values))
    factor = math.exp(float(stdtrit(len(values) - 1, 1.0 - _TAIL)) * error / middle)
    return middle, middle / factor, middle * factor


def rate_evidence(count: int, exposure: float, bound: float) -> float:
    """Return the evidence, after `count` events, that a rate is below a bound; see `enough`.

    The evidence is a likelihood ratio to the bound, mixed over rates below it: half of the weight on the rate 0, half
    spread evenly from 0 to the bound. If the true rate is the bound or more, its expectation never grows. So by
    Ville's inequality it exceeds 1/a with a probability of at most a, however often it is checked.

    Returns:
        The natural logarithm of the evidence.
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
    """Return whether evidence suffices at a level; it may be checked any number of times."""
    return log_evidence >= -math.log1p(-level)


def _half(first: float, second: float) -> float:
    most = max(first, second)
    return most + math.log((math.exp(first - most) + math.exp(second - most)) / 2.0)


def _log(value: float) -> float:
    return math.log(value) if value > 0.0 else -math.inf
