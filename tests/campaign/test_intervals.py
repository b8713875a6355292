"""Intervals are exact, and the evidence of a stopping rule may be looked at as often as one likes."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy
from hypothesis import given
from hypothesis import strategies as st

from soter.campaign.intervals import (
    enough,
    median,
    poisson,
    poisson_most,
    positive_mean,
    proportion,
    rate_evidence,
    share_evidence,
)

TAIL = 0.025


@given(st.integers(0, 2000), st.floats(0.01, 1e5))
def test_a_poisson_interval_ends_where_the_tails_are_the_level(count: int, hours: float) -> None:
    low, high = poisson(count, hours)
    assert scipy.stats.poisson.cdf(count, high * hours) == pytest.approx(TAIL)
    assert low == 0.0 if count == 0 else scipy.stats.poisson.sf(count - 1, low * hours) == pytest.approx(TAIL)


def test_no_event_in_t_hours_bounds_the_rate_by_3_over_t() -> None:
    assert poisson_most(0, 100.0) == pytest.approx(-math.log(0.05) / 100.0)
    assert poisson_most(0, 0.0) == math.inf


@given(st.integers(0, 300), st.integers(1, 300))
def test_a_clopper_pearson_interval_ends_where_the_tails_are_the_level(count: int, of: int) -> None:
    count = min(count, of)
    low, high = proportion(count, of)
    assert high == 1.0 if count == of else scipy.stats.binom.cdf(count, of, high) == pytest.approx(TAIL)
    assert low == 0.0 if count == 0 else scipy.stats.binom.sf(count - 1, of, low) == pytest.approx(TAIL)


def test_the_interval_of_a_median_covers_it_as_often_as_it_says() -> None:
    assert median([1.0] * 5) is None
    assert median([3.0, 1.0, 2.0, 4.0, 5.0, 6.0]) == (3.5, 1.0, 6.0)
    for count in range(6, 60):
        enclosed = median([float(each) for each in range(1, count + 1)])
        assert enclosed is not None
        outside = 2.0 * scipy.stats.binom.cdf(enclosed[1] - 1, count, 0.5)
        wider = 2.0 * scipy.stats.binom.cdf(enclosed[1], count, 0.5)
        assert outside <= 0.05 < wider, "the narrowest of those that hold"
        assert enclosed[2] == count + 1 - enclosed[1]


def test_the_interval_of_a_mean_holds_for_values_that_lie_apart_by_factors() -> None:
    drawn = np.random.default_rng(1).lognormal(-0.125, 0.5, (1000, 10))
    ends = [positive_mean(row) for row in drawn.tolist()]
    outside = sum(not low <= 1.0 <= high for _, low, high in ends)
    assert scipy.stats.binom.ppf(1e-3, 1000, 0.05) <= outside <= scipy.stats.binom.isf(1e-3, 1000, 0.05)
    assert positive_mean([0.0, 0.0]) == (0.0, 0.0, math.inf)


@pytest.mark.parametrize(("count", "exposure"), [(0, 40.0), (1, 60.0), (7, 100.0)])
def test_evidence_of_a_rate_is_the_mixture_that_it_says(count: int, exposure: float) -> None:
    bound = 0.1

    def ratio(part: float) -> float:
        return part**count * math.exp((1.0 - part) * bound * exposure)

    mixed = (ratio(0.0) + scipy.integrate.quad(ratio, 0.0, 1.0)[0]) / 2.0
    assert rate_evidence(count, exposure, bound) == pytest.approx(math.log(mixed))


@pytest.mark.parametrize(("count", "of"), [(0, 50), (2, 80), (80, 80)])
def test_evidence_of_a_share_is_the_mixture_that_it_says(count: int, of: int) -> None:
    bound = 0.2

    def ratio(share: float) -> float:
        return (share / bound) ** count * ((1.0 - share) / (1.0 - bound)) ** (of - count)

    mixed = (ratio(0.0) + scipy.integrate.quad(ratio, 0.0, bound, epsabs=0.0)[0] / bound) / 2.0
    assert share_evidence(count, of, bound) == pytest.approx(math.log(mixed), rel=1e-6)


def test_looking_after_every_run_is_wrong_as_seldom_as_the_level_allows() -> None:
    """At the bound itself, where it is hardest: of 1000 campaigns of 300 looks, at most 5 % may claim to be below."""
    rng = np.random.default_rng(1)
    bound, hours, campaigns = 0.05, 4.0, 1000
    events = rng.poisson(bound * hours, (campaigns, 300)).cumsum(axis=1)
    known: dict[tuple[int, int], bool] = {}

    def claims(count: int, looks: int) -> bool:
        key = count, looks
        if key not in known:
            known[key] = enough(rate_evidence(count, looks * hours, bound), 0.95)
        return known[key]

    wrong = sum(any(claims(int(n), k) for k, n in enumerate(row, 1)) for row in events)
    naive = sum(any(poisson_most(0, k * hours) < bound for k, n in enumerate(row, 1) if n == 0) for row in events)
    assert wrong <= scipy.stats.binom.isf(1e-3, campaigns, 0.05)
    assert naive > 0
    assert not enough(rate_evidence(0, 0.0, bound), 0.95)


def test_without_an_event_little_more_is_needed_than_3_over_the_bound() -> None:
    hours = next(hours for hours in range(1, 1000) if enough(rate_evidence(0, hours, 0.1), 0.95))
    assert 30 < hours <= 36
