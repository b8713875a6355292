"""Links: UDP and TCP, several vehicles on one port, signatures, damage, readers who do not read."""

from __future__ import annotations

import hashlib
import socket
import time
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.errors import ConfigError
from soter.sdk.values import RobotSpec
from soter_sim.mavlink.signing import read_key
from soter_sim.mavlink.simulation import Settings, Simulation
from tests.sim.mavlink.client import ACCEPTED, HOST, Client, Rig, signing_time
from tests.sim.worlds import empty

KEY = hashlib.sha256(b"open sesame").digest()


def free_port() -> int:
    """A UDP port that nobody uses now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((HOST, 0))
        return int(probe.getsockname()[1])


def test_several_vehicles_share_one_udp_port() -> None:
    with Rig(count=3, udp=(free_port(),)) as rig:
        rig.run(2.0)
        for robot in (1, 2, 3):
            beats = rig.client.take("HEARTBEAT", robot)
            assert len(beats) >= 2
            # Each numbers its own packets.
            numbers = [each.get_seq() for each in beats]
            assert numbers == sorted(numbers)
            assert {each.get_srcComponent() for each in beats} == {1}
            rig.guided(robot)
            rig.target(4.0 + robot, 6.0, to=robot)
        rig.run(8.0)
        for robot in (1, 2, 3):
            assert rig.at(robot) == pytest.approx((4.0 + robot, 6.0), abs=0.01)


def test_nobody_listening_on_udp_is_no_failure_and_who_comes_later_is_heard() -> None:
    port = free_port()
    with Simulation(empty(), [RobotSpec(1, 5.0, 5.0, 0.0)], Settings(udp=(port,), boot_s=0.0)) as simulation:
        for _ in range(100):
            simulation.step()
        late = Client(f"udpin:{HOST}:{port}")
        try:
            for _ in range(60):
                simulation.step()
            assert late.take("HEARTBEAT")
        finally:
            late.close()
        for _ in range(100):
            simulation.step()


def test_what_does_not_come_from_the_ground_station_is_dropped() -> None:
    port = free_port()
    with Rig(udp=(port,)) as rig:
        rig.run(1.0)
        stranger = Client(f"udpin:{HOST}:0")
        try:
            stranger._peer = rig.client._peer
            stranger.send(mav.MAVLink_command_long_message(1, 1, mav.MAV_CMD_DO_SET_MODE, 0, 1, 4, 0, 0, 0, 0, 0))
            rig.run(1.0)
            stranger.pump()
            assert stranger.heard == []
            assert rig.autopilot.mode.value == "MANUAL"
        finally:
            stranger.close()


def test_many_ground_stations_over_tcp_and_one_that_leaves() -> None:
    with Rig() as rig:
        others = [rig.connect(250 + number, 1) for number in range(3)]
        rig.run(2.0)
        assert all(each.take("HEARTBEAT") for each in others)
        leaver = others.pop()
        leaver.close()
        rig.clients.remove(leaver)
        rig.run(2.0)
        assert all(each.take("HEARTBEAT") for each in others)
        assert rig.mode(4, by=others[0]) == ACCEPTED
        # The answer is for who asked.
        assert rig.client.take("COMMAND_ACK") == []


def test_one_link_beside_the_other() -> None:
    port = free_port()
    with Rig(udp=(port,), tcp=(0,)) as rig:
        other = Client(rig.simulation.links[1].address)
        rig.clients.append(other)
        rig.run(2.0)
        assert rig.client.take("HEARTBEAT")
        assert other.take("HEARTBEAT")


def test_noise_and_damaged_packets_are_passed_over() -> None:
    with Rig() as rig:
        good = mav.MAVLink_command_long_message(1, 1, mav.MAV_CMD_DO_SET_MODE, 0, 1, 4, 0, 0, 0, 0, 0)
        packet = bytearray(good.pack(mav.MAVLink(None, 255, 190)))
        broken = bytearray(packet)
        broken[15] ^= 0xFF
        rig.client.send_raw(b"no mavlink at all" + bytes(broken) + b"\x00\x01\x02")
        rig.run(0.1)
        assert rig.autopilot.mode.value == "MANUAL"
        # In pieces, as a stream may bring it.
        for begin in range(0, len(packet), 7):
            rig.client.send_raw(bytes(packet[begin : begin + 7]))
            rig.run(rig.period_s)
        assert rig.autopilot.mode.value == "HOLD"


def test_half_a_datagram_does_not_swallow_the_next() -> None:
    with Rig(udp=(free_port(),)) as rig:
        rig.run(1.0)
        good = mav.MAVLink_command_long_message(1, 1, mav.MAV_CMD_DO_SET_MODE, 0, 1, 4, 0, 0, 0, 0, 0)
        packet = good.pack(mav.MAVLink(None, 255, 190))
        rig.client.send_raw(packet[:20])
        rig.client.send_raw(packet)
        rig.run(0.1)
        assert rig.autopilot.mode.value == "HOLD"


def test_messages_that_no_vehicle_knows_are_passed_over() -> None:
    with Rig() as rig:
        unknown = mav.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)
        packet = bytearray(unknown.pack(mav.MAVLink(None, 255, 190)))
        packet[7:10] = b"\xfe\xff\x7f"
        rig.client.send_raw(bytes(packet))
        rig.client.send(mav.MAVLink_attitude_message(0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        assert rig.mode(4) == ACCEPTED


def test_a_signed_link_obeys_who_signs_and_nobody_else() -> None:
    with Rig(key=KEY) as rig:
        rig.run(1.0)
        beats = rig.client.take("HEARTBEAT")
        assert beats
        assert all(each.get_signed() for each in beats)
        assert rig.client.bad == 0
        assert rig.mode(4) == ACCEPTED
        for key in (None, hashlib.sha256(b"something else").digest()):
            stranger = rig.connect(254, 1, key)
            assert rig.mode(15, by=stranger) is None
            assert rig.autopilot.mode.value == "HOLD"
        # Who holds another key cannot read it either; who holds none may, as MAVLink has it.
        assert rig.clients[-1].bad > 0
        assert rig.clients[-2].take("HEARTBEAT")


def test_a_packet_that_was_signed_and_recorded_does_nothing_when_it_is_played_back() -> None:
    with Rig(key=KEY) as rig:
        sender = mav.MAVLink(None, 255, 77)
        sender.signing.secret_key, sender.signing.sign_outgoing, sender.signing.timestamp = KEY, True, signing_time()
        hold = mav.MAVLink_command_long_message(1, 1, mav.MAV_CMD_DO_SET_MODE, 0, 1, 4, 0, 0, 0, 0, 0).pack(sender)
        rig.client.send_raw(hold)
        rig.run(0.1)
        assert rig.autopilot.mode.value == "HOLD"
        assert rig.mode(15) == ACCEPTED
        rig.client.send_raw(hold)
        rig.run(0.1)
        assert rig.autopilot.mode.value == "GUIDED"


def test_a_key_is_read_from_the_first_line_of_a_file(tmp_path: Path) -> None:
    file = tmp_path / "passphrase"
    file.write_text("open sesame\nnot this\n")
    assert read_key(file) == KEY
    file.write_text("\n")
    with pytest.raises(ConfigError, match="passphrase in the first line"):
        read_key(file)
    with pytest.raises(ConfigError, match="cannot be read"):
        read_key(tmp_path / "nowhere")


def test_who_does_not_read_holds_up_nobody_and_gets_whole_packets_when_it_does() -> None:
    with Rig() as rig:
        deaf = socket.create_connection((HOST, int(rig.simulation.links[0].address.split(":")[2])))
        try:
            rig.run(0.1)
            sender = mav.MAVLink(None, 254, 1)
            for number in (1, 2, 24, 30, 31, 32, 33, 42, 74, 147, 148, 193, 242, 245, 252):
                interval = (1, 1, mav.MAV_CMD_SET_MESSAGE_INTERVAL, 0, number, 25_000, 0, 0, 0, 0, 0)
                deaf.sendall(mav.MAVLink_command_long_message(*interval).pack(sender))
            # More than the buffers of the operating system hold.
            rig.run(60.0)
            assert rig.mode(4) == ACCEPTED
            parser = mav.MAVLink(None)
            parser.robust_parsing = True
            deaf.setblocking(False)
            newest_ms, until_s = 0, time.monotonic() + 30.0
            while newest_ms < rig.autopilot.boot_ms:
                assert time.monotonic() < until_s, "it never caught up"
                rig.run(rig.period_s)
                try:
                    data = deaf.recv(1 << 20)
                except BlockingIOError:
                    continue
                for message in parser.parse_buffer(data) or ():
                    assert message.get_type() != "BAD_DATA"
                    newest_ms = max(newest_ms, getattr(message, "time_boot_ms", 0))
        finally:
            deaf.close()


def test_a_port_that_is_taken_is_named() -> None:
    with socket.create_server((HOST, 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(OSError, match=f"port {port} of 127.0.0.1 cannot be listened on"):
            Simulation(empty(), [RobotSpec(1, 5.0, 5.0, 0.0)], Settings(tcp=(port,)))
