"""The links on real sockets of this host: what is heard, what is not, and what comes back after it was lost."""

from __future__ import annotations

import math
import os
import pty
import socket
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.adapters.mavlink.authority import COMPONENTS, KEEPER, SENDERS
from soter.adapters.mavlink.harness import MavlinkRelay
from soter.adapters.mavlink.link import Inbox, MavlinkLink
from soter.adapters.mavlink.mavsdk_link import MavsdkLink
from soter.adapters.mavlink.pymavlink_link import SILENT_S, PymavlinkLink, signing_key
from soter.adapters.mavlink.simulator import free_port
from soter.adapters.mavlink.transport import Address, Peer, StreamTransport, Transport
from soter.clock import VehicleClock
from soter.errors import RobotUnavailable
from soter.sdk import Controller
from tests.waiting import eventually

OURS = 255
HEARTBEAT = mav.MAVLink_heartbeat_message(mav.MAV_TYPE_GROUND_ROVER, mav.MAV_AUTOPILOT_ARDUPILOTMEGA, 0, 15, 4, 3)


def packed(message: mav.MAVLink_message, system: int = 1, component: int = 1, key: bytes | None = None) -> bytes:
    codec = mav.MAVLink(None, system, component)
    if key is not None:
        codec.signing.secret_key, codec.signing.sign_outgoing = key, True
        codec.signing.timestamp = int((time.time() - 1_420_070_400) * 100_000)
    return bytes(message.pack(codec))


def position(stamp_ms: int, north_m: float = 1.0) -> mav.MAVLink_message:
    return mav.MAVLink_local_position_ned_message(stamp_ms, north_m, 2.0, 0.0, 0.0, 0.0, 0.0)


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as opened:
        yield opened


def opened(stack: ExitStack, link: MavlinkLink, *systems: int) -> MavlinkLink:
    for system in systems or (1,):
        link.inboxes[system] = Inbox()
    stack.callback(link.close)
    link.start()
    return link


def udp(stack: ExitStack, key: bytes | None = None) -> tuple[MavlinkLink, socket.socket, tuple[str, int]]:
    port = free_port()
    link = PymavlinkLink(VehicleClock(), Address("udpin", "127.0.0.1", port), OURS, COMPONENTS, key)
    vehicle = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    vehicle.bind(("127.0.0.1", 0))
    vehicle.settimeout(5.0)
    return opened(stack, link), vehicle, ("127.0.0.1", port)


def test_the_latest_message_is_kept_with_when_it_came(stack: ExitStack) -> None:
    link, vehicle, there = udp(stack)
    before_s = link.clock.steady_s()
    for stamp_ms in (20, 40, 60):
        vehicle.sendto(packed(position(stamp_ms)), there)
    inbox = link.inboxes[1]
    assert eventually(lambda: inbox.counts.get("LOCAL_POSITION_NED") == 3)
    heard = inbox.latest["LOCAL_POSITION_NED"]
    assert heard.message.time_boot_ms == 60
    assert before_s < heard.received_s <= link.clock.steady_s()


def test_a_foreign_heartbeat_changes_nothing(stack: ExitStack) -> None:
    link, vehicle, there = udp(stack)
    stranger = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    vehicle.sendto(packed(HEARTBEAT), there)
    assert eventually(lambda: "HEARTBEAT" in link.inboxes[1].latest)
    ours = link.inboxes[1].latest["HEARTBEAT"]
    stranger.sendto(packed(HEARTBEAT, system=9), there)
    # A camera of the same vehicle is no autopilot.
    stranger.sendto(packed(HEARTBEAT, component=100), there)
    assert eventually(lambda: link.strangers == {9})
    assert link.inboxes[1].latest["HEARTBEAT"] is ours
    link.send(1, KEEPER, "TIMESYNC", {"tc1": 0, "ts1": 1})
    assert vehicle.recv(1000)


def test_each_controller_speaks_as_a_component_of_its_own(stack: ExitStack) -> None:
    link, vehicle, there = udp(stack)
    vehicle.sendto(packed(HEARTBEAT), there)
    assert eventually(lambda: link.inboxes[1].latest)
    parser = mav.MAVLink(None)
    for component in (SENDERS[Controller.AC], SENDERS[Controller.SC]):
        link.send(1, component, "TIMESYNC", {"tc1": 0, "ts1": 1})
        (message,) = parser.parse_buffer(vehicle.recv(1000)) or []
        assert (message.get_srcSystem(), message.get_srcComponent()) == (OURS, component)
    link.beat(1)
    (message,) = parser.parse_buffer(vehicle.recv(1000)) or []
    assert (message.get_type(), message.get_srcComponent(), message.type) == ("HEARTBEAT", KEEPER, mav.MAV_TYPE_GCS)


def test_what_is_damaged_unknown_or_half_is_dropped(stack: ExitStack) -> None:
    link, vehicle, there = udp(stack)
    good = packed(position(10))
    unknown = bytearray(good)
    unknown[7:10] = (0xFF, 0xFF, 0xFF)
    for datagram in (b"", b"nonsense", good[:-1] + bytes([good[-1] ^ 1]), good[:9], bytes(unknown), good + good[:7]):
        vehicle.sendto(datagram, there)
    vehicle.sendto(packed(position(20)), there)
    inbox = link.inboxes[1]
    assert eventually(lambda: "LOCAL_POSITION_NED" in inbox.latest
                    and inbox.latest["LOCAL_POSITION_NED"].message.time_boot_ms == 20)  # fmt: skip
    assert inbox.counts == {"LOCAL_POSITION_NED": 2}


class Sent(Transport):
    """Keeps what is sent, and to whom."""

    def __init__(self) -> None:
        self.to: list[Peer] = []

    def receive(self, wait_s: float) -> list[tuple[bytes, Peer]]:
        return []

    def send(self, packet: bytes, peer: Peer) -> None:
        self.to.append(peer)

    def close(self) -> None:
        pass


def unopened(key: bytes | None = None) -> tuple[PymavlinkLink, Sent, list[float]]:
    """A link that hears what a test hands to it, at the times that the test sets."""
    now_s = [100.0]
    link = PymavlinkLink(VehicleClock(steady=lambda: now_s[0]), Address("udpin", "127.0.0.1", 1), OURS, COMPONENTS, key)
    link.inboxes[1] = Inbox()
    link._transport = sent = Sent()
    return link, sent, now_s


HERE, THERE = ("127.0.0.1", 1000), ("127.0.0.1", 2000)


def test_a_stray_packet_redirects_nothing_and_is_named(caplog: pytest.LogCaptureFixture) -> None:
    link, sent, now_s = unopened()
    link._take(packed(position(10)), HERE)
    for _ in range(3):
        now_s[0] += 0.1
        link._take(packed(position(5000, north_m=9.0)), THERE)
    link.send(1, KEEPER, "TIMESYNC", {"tc1": 0, "ts1": 1})
    assert sent.to == [HERE]
    assert link.inboxes[1].latest["LOCAL_POSITION_NED"].message.time_boot_ms == 10
    assert str(link.duplicates[1]) == (
        "two vehicles have its system id: one at 127.0.0.1:1000, which is used, and one at 127.0.0.1:2000"
    )
    assert link.duplicates[1].messages == 3
    assert caplog.text.count("give each vehicle a system id of its own") == 1


def test_a_vehicle_that_comes_back_at_another_address_is_answered_there() -> None:
    link, sent, now_s = unopened()
    link._take(packed(HEARTBEAT), HERE)
    now_s[0] += SILENT_S
    link._take(packed(HEARTBEAT), THERE)
    assert link.inboxes[1].counts["HEARTBEAT"] == 2
    link.send(1, KEEPER, "TIMESYNC", {"tc1": 0, "ts1": 2})
    assert sent.to == [THERE]


def test_a_forged_signature_of_the_far_future_deafens_nobody() -> None:
    key = signing_key("a passphrase")
    link, _, _ = unopened(key)
    forged = bytearray(packed(position(10), key=key))
    forged[-12:-6] = b"\xff" * 6
    link._take(bytes(forged), HERE)
    assert not link.inboxes[1].counts
    link._take(packed(position(20), key=key), HERE)
    assert link.inboxes[1].counts == {"LOCAL_POSITION_NED": 1}
    link._take(bytes(forged), HERE)
    time.sleep(0.001)  # signatures count units of 10 microseconds
    link._take(packed(position(30), key=key), HERE)
    assert link.inboxes[1].counts == {"LOCAL_POSITION_NED": 2}


def test_a_stream_whose_messages_never_end_with_a_packet_is_not_kept() -> None:
    link, _, _ = unopened()
    frame = packed(position(10))
    link._take(frame[:5], None)
    for _ in range(200):
        link._take(frame[5:] + frame[:5], None)
    assert link.inboxes[1].counts == {"LOCAL_POSITION_NED": 200}
    assert len(link._parser.buf) <= len(frame)


def test_what_is_not_signed_with_our_key_is_not_heard(stack: ExitStack) -> None:
    key = signing_key("a passphrase")
    link, vehicle, there = udp(stack, key)
    for wrong in (None, signing_key("another")):
        vehicle.sendto(packed(position(10), key=wrong), there)
    vehicle.sendto(packed(position(20), key=key), there)
    inbox = link.inboxes[1]
    assert eventually(lambda: "LOCAL_POSITION_NED" in inbox.latest)
    assert inbox.counts == {"LOCAL_POSITION_NED": 1}
    link.send(1, KEEPER, "TIMESYNC", {"tc1": 0, "ts1": 1})
    parser = mav.MAVLink(None)
    parser.signing.secret_key = key
    (message,) = parser.parse_buffer(vehicle.recv(1000)) or []
    assert message.get_signed()


def test_a_port_that_is_taken_is_named(stack: ExitStack) -> None:
    _, _, (host, port) = udp(stack)
    for kind in (PymavlinkLink, MavsdkLink):
        with pytest.raises(RobotUnavailable, match=rf"udpin:{host}:{port}.*end the other program"):
            kind(VehicleClock(), Address("udpin", host, port), OURS, COMPONENTS).start()


def test_a_host_that_is_none_is_named() -> None:
    with pytest.raises(RobotUnavailable, match="cannot be opened"):
        PymavlinkLink(VehicleClock(), Address("udpout", "no.such.host.invalid", 1), OURS, COMPONENTS).start()


def test_a_tcp_server_is_waited_for_and_found_again(stack: ExitStack) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    link = opened(stack, PymavlinkLink(VehicleClock(), Address("tcp", "127.0.0.1", port), OURS, COMPONENTS))
    # Nobody is there: nothing is sent, and nothing waits or raises.
    link.send(1, KEEPER, "TIMESYNC", {"tc1": 0, "ts1": 1})
    inbox = link.inboxes[1]
    for number in (1, 2):
        with socket.create_server(("127.0.0.1", port)) as server:
            server.settimeout(5.0)
            vehicle, _ = server.accept()
            with vehicle:
                data = packed(position(10 * number))
                vehicle.sendall(data[:5])
                time.sleep(0.02)
                vehicle.sendall(data[5:])
                assert eventually(lambda number=number: inbox.counts.get("LOCAL_POSITION_NED") == number)  # type: ignore[misc]
                link.send(1, KEEPER, "TIMESYNC", {"tc1": 0, "ts1": 1})
                vehicle.settimeout(5.0)
                assert vehicle.recv(1000)


def test_a_peer_that_does_not_read_costs_messages_and_no_time(stack: ExitStack) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = Address("tcp", "127.0.0.1", server.getsockname()[1])
        link = opened(stack, PymavlinkLink(VehicleClock(), address, OURS, COMPONENTS))
        vehicle, _ = server.accept()
        with vehicle:
            vehicle.sendall(packed(HEARTBEAT))
            assert eventually(lambda: link.inboxes[1].latest)
            vehicle.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            slowest_s = 0.0
            for _ in range(30_000):
                began_s = time.thread_time()
                link.send(1, KEEPER, "TIMESYNC", {"tc1": 0, "ts1": 1})
                slowest_s = max(slowest_s, time.thread_time() - began_s)
            assert slowest_s < 0.05
        # It is gone now, in the middle of a message; writing to it raises nothing either.
        for _ in range(10):
            link.send(1, KEEPER, "TIMESYNC", {"tc1": 0, "ts1": 1})
            time.sleep(0.01)


def test_a_serial_line_is_read_and_written(stack: ExitStack) -> None:
    ours, theirs = pty.openpty()
    stack.callback(os.close, ours)
    stack.callback(os.close, theirs)
    link = opened(stack, PymavlinkLink(VehicleClock(), Address("serial", os.ttyname(theirs), 57600), OURS, COMPONENTS))
    assert eventually(lambda: _write_and_hear(ours, link))
    link.send(1, KEEPER, "TIMESYNC", {"tc1": 0, "ts1": 1})
    # Until the line was raw it gave back what was written to it.
    parser = mav.MAVLink(None)
    parser.robust_parsing = True
    assert eventually(
        lambda: "TIMESYNC" in [message.get_type() for message in parser.parse_buffer(os.read(ours, 1000)) or []]
    )


def _write_and_hear(descriptor: int, link: MavlinkLink) -> bool:
    os.write(descriptor, packed(HEARTBEAT))
    return eventually(lambda: link.inboxes[1].latest, 0.2)


def test_a_baud_rate_that_does_not_exist_is_no_line() -> None:
    transport = StreamTransport(Address("serial", "/dev/null", 12345))
    assert transport.receive(0.0) == []
    transport.close()


def test_mavsdk_hears_the_same_and_speaks_as_the_same_components(
    stack: ExitStack, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    port = free_port()
    link = opened(stack, MavsdkLink(VehicleClock(), Address("udpin", "127.0.0.1", port), OURS, COMPONENTS), 1, 2)
    vehicle = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    vehicle.settimeout(5.0)
    codec = {system: mav.MAVLink(None, system, 1) for system in (1, 2, 9)}

    def speak() -> bool:
        for system, each in codec.items():
            for message in (HEARTBEAT, position(20, math.nan if system == 2 else 1.5)):
                vehicle.sendto(bytes(message.pack(each)), ("127.0.0.1", port))
                each.seq = (each.seq + 1) % 256
        return all("LOCAL_POSITION_NED" in inbox.latest for inbox in link.inboxes.values())

    assert eventually(speak)
    assert link.inboxes[1].latest["LOCAL_POSITION_NED"].message.x == 1.5
    # JSON has no NaN; what was none must not become a number.
    assert math.isnan(link.inboxes[2].latest["LOCAL_POSITION_NED"].message.x)
    assert eventually(lambda: link.strangers == {9})
    link.send(1, SENDERS[Controller.AC], "SET_POSITION_TARGET_LOCAL_NED", {
        "time_boot_ms": 0, "target_system": 1, "target_component": 1, "coordinate_frame": 1, "type_mask": 0x0DF8,
        **dict.fromkeys(("x", "y", "z", "vx", "vy", "vz", "afx", "afy", "afz", "yaw", "yaw_rate"), 0.5),
    })  # fmt: skip
    parser = mav.MAVLink(None)
    parser.robust_parsing = True
    said: list[tuple[str, int]] = []

    def heard() -> bool:
        said.extend(
            (each.get_type(), each.get_srcComponent()) for each in parser.parse_buffer(vehicle.recv(1000)) or []
        )
        return ("SET_POSITION_TARGET_LOCAL_NED", SENDERS[Controller.AC]) in said

    assert eventually(heard)
    # What the library leaves behind if it is killed lies where the next run finds it.
    made = [path.parent for path in tmp_path.rglob("mavsdk-*")]
    assert made
    assert all((folder / ".lock").exists() for folder in made)
    link.close()
    assert not [*tmp_path.iterdir()]


def test_the_kits_relay_passes_on_what_is_no_whole_packet() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as adapter, socket.socket(type=socket.SOCK_DGRAM) as vehicle:
        adapter.bind(("127.0.0.1", 0))
        adapter.settimeout(10.0)
        relay = MavlinkRelay(adapter.getsockname()[1])
        for datagram in (b"\xfd\x01", b"\xfd" * 12):
            vehicle.sendto(datagram, ("127.0.0.1", relay.port))
            assert adapter.recvfrom(64)[0] == datagram
        relay.close()


def test_the_kits_relay_tells_vehicles_that_send_from_ports_of_their_own() -> None:
    opened = [socket.socket(type=socket.SOCK_DGRAM) for _ in range(3)]
    adapter, first, second = opened
    adapter.bind(("127.0.0.1", 0))
    relay = MavlinkRelay(adapter.getsockname()[1])
    for each in opened:
        each.settimeout(10.0)
    first.sendto(packed(HEARTBEAT, 1), ("127.0.0.1", relay.port))
    adapter.recvfrom(64)
    second.sendto(packed(HEARTBEAT, 2), ("127.0.0.1", relay.port))
    _, there = adapter.recvfrom(64)
    # The first one is told, too, though the other one was heard last.
    told = packed(mav.MAVLink_set_mode_message(1, 1, 15), 255, 190)
    adapter.sendto(told, there)
    assert first.recvfrom(64)[0] == second.recvfrom(64)[0] == told
    # Of what is for all, only one that is cut off hears nothing.
    relay.cut = frozenset({2})
    adapter.sendto(packed(HEARTBEAT, 255, 190), there)
    assert first.recvfrom(64)[0] == packed(HEARTBEAT, 255, 190)
    second.settimeout(0.1)
    with pytest.raises(TimeoutError):
        second.recvfrom(64)
    relay.close()
    for each in opened:
        each.close()
