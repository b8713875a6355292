from __future__ import annotations

import pytest

from soter.adapters.zenoh.session_options import Endpoint


@pytest.mark.parametrize(
    ("text", "protocol", "host", "port", "local"),
    [
        ("tcp/127.0.0.1:7447", "tcp", "127.0.0.1", 7447, True),
        ("tls/[::1]:0", "tls", "::1", 0, True),
        ("tcp/localhost:65535", "tcp", "localhost", 65535, True),
        ("tcp/[::ffff:127.0.0.1]:7447", "tcp", "::ffff:127.0.0.1", 7447, True),
        ("tls/robot1.example.org:7447", "tls", "robot1.example.org", 7447, False),
        ("tcp/10.0.0.7:7447", "tcp", "10.0.0.7", 7447, False),
        ("tcp/[2001:db8::7]:7447", "tcp", "2001:db8::7", 7447, False),
        ("tcp/[::]:7447", "tcp", "::", 7447, False),
    ],
)
def test_an_endpoint_is_read_and_written(text: str, protocol: str, host: str, port: int, local: bool) -> None:
    found = Endpoint.parse(text)
    assert (found.protocol, found.host, found.port, found.is_local) == (protocol, host, port, local)
    assert str(found) == text


@pytest.mark.parametrize(
    "text",
    [
        "",
        "tcp",
        "tcp/127.0.0.1",
        "127.0.0.1:7447",
        "udp/127.0.0.1:7447",
        "quic/127.0.0.1:7447",
        "tcp:127.0.0.1:7447",
        "tcp/:7447",
        "tcp/::1:7447",
        "tcp/[]:7447",
        "tcp/[localhost]:7447",
        "tcp/127.0.0.1:65536",
        "tcp/127.0.0.1:-1",
        "tcp/127.0.0.1:000007447",
        "tcp/127.0.0.1:7447#iface=eth0",
        "tcp/127.0.0.1#iface=eth0:7447",
        "tls/host?prio=1:7447",
        "tcp/two hosts:7447",
        "tcp/höst:7447",
    ],
)
def test_what_is_no_endpoint_says_what_is_allowed(text: str) -> None:
    with pytest.raises(ValueError, match="tcp/HOST:PORT or tls/HOST:PORT"):
        Endpoint.parse(text)
