"""Whatever a file holds, reading it gives a result or a ConfigError, and nothing else."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from hypothesis import example, given, settings
from hypothesis import strategies as st

from soter.config import parse_mission
from soter.errors import ConfigError
from soter.geometry.workspace_xml import parse_workspace

EXAMPLES = Path(__file__).parents[2] / "examples"
XML = (EXAMPLES / "surveillance.xml").read_bytes()
TOML = (EXAMPLES / "surveillance.toml").read_bytes()
FRAGMENTS = [
    b"",
    b"\0",
    b"\xff\xfe",
    b"\xef\xbb\xbf",
    b"<",
    b">",
    b"/>",
    b'"',
    b"'",
    b"&",
    b"&amp;",
    b"&#0;",
    b"&x;",
    b"<!--",
    b"-->",
    b"<![CDATA[",
    b"]]>",
    b"<?xml",
    b"?>",
    b"<!DOCTYPE x>",
    b"<box>",
    b"</box>",
    b"<low/>",
    b"<robots/>",
    b'id="1"',
    b'xmlns="x"',
    b"a:b",
    b"nan",
    b"-inf",
    b"1e999",
    b"99999999999999999999",
    b"-1",
    b"[",
    b"]",
    b"{",
    b"}",
    b"=",
    b"\n",
    b"[rta]",
    b"[[rta]]",
    b"rta.collision",
    b"x = 1\n",
    b"1979-05-27",
    b"true",
    b'"""',
    b"#",
    b".",
    b",",
    b"\x0b",
    b"\xc2\x85",
    b"\xe2\x80\xa8",
    b"0x1F",
    b"2 = 0.17",
    b'"" = 1\n',
    b"''.'' = {}\n",
    b"+nan",
    b"5" * 5000,
]
steady = settings(max_examples=200, derandomize=True, deadline=None)


@st.composite
def mutated(draw: st.DrawFn, original: bytes) -> bytes:
    """A good file with up to four pieces cut out, doubled or put in."""
    data = original
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(data)))
        end = min(len(data), start + draw(st.integers(0, 40)))
        piece = draw(st.sampled_from(FRAGMENTS) | st.binary(max_size=8) | st.just(2 * data[start:end]))
        data = data[:start] + piece + data[end:]
    return data


def survives(read: Callable[[bytes, str], object], data: bytes) -> None:
    try:
        read(data, "file")
    except ConfigError as failure:
        assert str(failure).startswith("file")  # noqa: PT017 - what matters is that nothing else is raised
        assert len(str(failure)) < 10_000  # noqa: PT017


@steady
@given(st.binary(max_size=200))
@example(b'<?xml version="1.0" encoding="utf-16"?><a/>')
@example(b'<?xml version="1.0" encoding="utf-7"?><a/>')
@example(b'<?xml version="1.0" encoding="idna"?><a/>')
@example(b'<?xml version="1.0" encoding="hex"?><a/>')
def test_bytes_as_a_workspace(data: bytes) -> None:
    survives(parse_workspace, data)


@steady
@given(mutated(XML))
def test_a_mutated_workspace(data: bytes) -> None:
    survives(parse_workspace, data)


@steady
@given(
    st.lists(
        st.sampled_from(
            [
                b"<configuration>",
                b"</configuration>",
                b'<dimension x="5" y="5" z="1"/>',
                b"<robots>",
                b"</robots>",
                b'<robot id="1">',
                b"</robot>",
                b'<start x="1" y="1"/>',
                b"<charging_stations>",
                b"</charging_stations>",
                b"<box>",
                b"</box>",
                b'<low x="0.8" y="0.8" z="0"/>',
                b'<high x="1.2" y="1.2" z="1"/>',
                b"<obstacles>",
                b"</obstacles>",
            ]
        ),
        max_size=20,
    ).map(b"".join)
)
def test_shuffled_elements(data: bytes) -> None:
    survives(parse_workspace, data)


@steady
@given(st.binary(max_size=200) | st.text(max_size=200).map(lambda text: text.encode("utf-8", "surrogatepass")))
@example(b"a." * 5000 + b"b = 1")
@example(b"workspace = " + b"9" * 5000)
@example(b"workspace = 'x'\nseed = " + b"9" * 5000)
@example(b"workspace = 'x'\nseed = 0x" + b"f" * 5000)
@example(b"workspace = 'x'\n[battery.initial]\n" + b"9" * 5000 + b" = 1")
@example(b"x = " + b"{a = " * 5000)
def test_bytes_as_a_mission(data: bytes) -> None:
    survives(parse_mission, data)


@steady
@given(mutated(TOML))
def test_a_mutated_mission(data: bytes) -> None:
    survives(parse_mission, data)


json_like = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)
keys = st.sampled_from(
    [
        "",
        ".",
        "seed",
        "rta",
        "rta.modules",
        "rta.collision",
        "rta.collision.delta_s",
        "battery.initial",
        "battery",
        "battery.initial.2",
        "backends",
        "backends.x",
        "workspace",
        "robots",
        "base_tick_s",
        "targets",
        'a."b.c"',
    ]
) | st.text(max_size=10)


@steady
@given(st.dictionaries(keys, json_like, max_size=3))
def test_any_override(overrides: dict[str, object]) -> None:
    try:
        parse_mission(TOML, "file", overrides)
    except ConfigError as failure:
        assert str(failure)  # noqa: PT017 - what matters is that nothing else is raised
