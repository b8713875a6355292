"""Spoilt inputs of every format through everything that reads them; `tools/fuzz.py` does the same for hours."""

from __future__ import annotations

import random
from functools import cache

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tools.fuzz import reader
from tools.fuzzing import worlds
from tools.fuzzing.formats import NAMES, Format, make
from tools.fuzzing.mutate import spoil

EXAMPLES = {"mcap": 12, "cdr": 60} | dict.fromkeys(worlds.NAMES, 25)
SEEDS = st.integers(0, 2**32)


@cache
def made(name: str) -> Format:
    return make(name)


@pytest.mark.parametrize("name", NAMES)
def test_good_inputs_are_read(name: str) -> None:
    for seed in made(name).seeds:
        made(name).read(seed)


@pytest.mark.parametrize("name", NAMES)
def test_spoilt_inputs_are_read_or_refused(name: str) -> None:
    chosen = made(name)

    @settings(max_examples=EXAMPLES.get(name, 200))
    @given(SEEDS)
    def survives(seed: int) -> None:
        chosen.read(chosen.spoilt(seed))

    survives()


@given(st.binary(max_size=100), SEEDS)
def test_the_same_number_spoils_in_the_same_way(data: bytes, seed: int) -> None:
    assert spoil(data, [data], random.Random(seed)) == spoil(data, [data], random.Random(seed))


def test_what_is_raised_is_found() -> None:
    def read(data: bytes) -> None:
        raise KeyError(data)

    assert "KeyError: b'x'" in reader(Format((b"x",), read))(b"x")
