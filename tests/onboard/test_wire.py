from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.onboard.wire import AC, MOST_BYTES, SC, SEQ_MOST, GateReport, Order


@pytest.mark.parametrize("order", [Order("ab12", 7, AC, 1012.5), Order("ab12", 8, SC, None)])
def test_an_order_arrives_as_it_was_sent(order: Order) -> None:
    assert Order.decode(order.encode()) == order


def test_a_report_arrives_as_it_was_sent() -> None:
    report = GateReport("ab12", 7, AC, True)
    assert GateReport.decode(report.encode()) == report


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "Expecting value"),
        ("[]", "not an object"),
        ("{}", "seq is None, allowed: a whole number from 0 to"),
        ('{"seq": 1}', "controller is None, allowed: AC or SC"),
        ('{"seq": 1, "controller": "both"}', "controller is 'both', allowed: AC or SC"),
        ('{"seq": true, "controller": "AC"}', "seq is True"),
        ('{"seq": 1, "controller": "AC", "renewed_s": NaN}', "renewed_s is nan"),
        ('{"seq": 1, "controller": "AC", "renewed_s": "now"}', "renewed_s is 'now'"),
        ('{"seq": 1' + "0" * 400 + "}", "seq is 1000"),
        ('{"seq": 1e300, "controller": "AC"}', "seq is 1e\\+300"),
        ('{"seq": -1, "controller": "AC"}', "seq is -1"),
        ('{"seq": 7.0, "controller": "AC"}', "seq is 7.0"),
        ('{"seq": 1, "controller": "AC", "renewed_s": 1' + "0" * 400 + "}", "renewed_s is 1000"),
        ('{"a": ' * 20000, "120000 characters, allowed: at most"),
        ("[" * 2000, "nested too deeply|Expecting value"),
        (b"\xff", "invalid start byte"),
        ('{"seq": 1, "controller": "AC", "session": [1]}', "session is \\[1\\]"),
        ('{"seq": 1, "controller": "AC", "session": "' + "s" * 65 + '"}', "session is 's.*at most 64 characters"),
    ],
)
def test_nonsense_is_named(text: str | bytes, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        Order.decode(text)


def test_a_report_of_nonsense_is_named() -> None:
    with pytest.raises(ValueError, match="controller is 1"):
        GateReport.decode('{"seq": 1, "controller": 1}')


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=80) | st.sampled_from([AC, SC, 1e300]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=5,
)
KEYS = st.sampled_from(["session", "seq", "controller", "renewed_s", "alive", "more"])
ANYTHING = st.binary(max_size=64) | st.text(max_size=64) | st.dictionaries(KEYS, VALUES).map(json.dumps)


@given(ANYTHING)
def test_whatever_is_heard_is_an_order_within_bounds_or_refused(heard: str | bytes) -> None:
    for kind in (Order, GateReport):
        try:
            found = kind.decode(heard)
        except ValueError:
            continue
        assert 0 <= found.seq <= SEQ_MOST
        assert found.controller in {AC, SC}
        # A mux repeats what it has taken; that must be legal as well.
        assert len(found.encode()) <= MOST_BYTES
        assert kind.decode(found.encode()) == found
