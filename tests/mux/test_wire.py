from __future__ import annotations

import pytest

from soter.mux.wire import AC, SC, GateReport, Order


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
        ("{}", "seq is None"),
        ('{"seq": 1}', "controller is None, allowed: AC or SC"),
        ('{"seq": 1, "controller": "both"}', "controller is 'both', allowed: AC or SC"),
        ('{"seq": true, "controller": "AC"}', "seq is True"),
        ('{"seq": 1, "controller": "AC", "renewed_s": NaN}', "renewed_s is nan"),
        ('{"seq": 1, "controller": "AC", "renewed_s": "now"}', "renewed_s is 'now'"),
    ],
)
def test_nonsense_is_named(text: str, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        Order.decode(text)


def test_a_report_of_nonsense_is_named() -> None:
    with pytest.raises(ValueError, match="controller is 1"):
        GateReport.decode('{"seq": 1, "controller": 1}')
