"""Gets a vehicle ready, and ready again after a reboot: asks for each missing thing until the vehicle reports it.

`step` asks for one thing at a time and never waits, so that both `init()` and the supervisor's tick can call it. That a
command was sent or accepted proves nothing: every step ends with a report of the vehicle itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator, Sequence
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mav

from soter.adapters.mavlink.ascent import Ascent
from soter.adapters.mavlink.authority import KEEPER, LEASE_PARAMETER, SENDERS, Authority
from soter.adapters.mavlink.fence import fence_items, put_up
from soter.adapters.mavlink.frames import ArduPilotSphere, GeoPoint
from soter.adapters.mavlink.item_lists import ItemLists
from soter.adapters.mavlink.options import MavlinkConfig
from soter.adapters.mavlink.parameters import JudgedParameters
from soter.adapters.mavlink.places import judge_places
from soter.adapters.mavlink.sampling import TimeSync
from soter.adapters.mavlink.setpoints import Setpoints
from soter.adapters.mavlink.vehicle import RETRY_S, Vehicle, place_of
from soter.adapters.mavlink.whereabouts import wait_for_accuracy
from soter.errors import RobotUnavailable
from soter.geometry.earth import Projection
from soter.sdk import Capabilities, Controller

_DUPLICATE_MESSAGES: Final = 3
"""Dropped messages that prove a duplicate; fewer may be stray packets."""

_TURN: Final = "its turn to arm"
_ANSWER_S: Final = 1.0
_KEEP_S: Final = 0.05
_SLOWER: Final = 0.8
_ASKED_HZ: Final = 50.0
_FLOWING: Final = 0.3
_COUNTED_S: Final = 0.5

STREAMS: Final = {
    "ATTITUDE": mav.MAVLINK_MSG_ID_ATTITUDE,
    "LOCAL_POSITION_NED": mav.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
}
"""The messages that samples are made of. ArduPilot sends no position before it knows it, after most of a minute."""

_SLOW_STREAMS: Final = (
    mav.MAVLINK_MSG_ID_HEARTBEAT, mav.MAVLINK_MSG_ID_SYS_STATUS, mav.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
    mav.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN, mav.MAVLINK_MSG_ID_HOME_POSITION,
)  # fmt: skip
_SLOW_HZ: Final = 4.0
_GPS_HZ: Final = 10.0
_PX4_EKF: Final = mav.MAVLINK_MSG_ID_ESTIMATOR_STATUS
_REPORT_HZ: Final = 20.0


class Preparation:
    """Gets one vehicle ready.

    Attributes:
        may_arm: whether the vehicle may be armed now; the steps that do not need it armed come before.
        armed_it: whether the vehicle was armed here.
        taken: whether the vehicle is the expected one and was sent requests, so that it has to be left in order.
        ready: whether nothing is missing.
        waits_for: what is missing, in words.
        gated: whether the vehicle has a gate of its own; None until it has answered, also after each beginning.
        origin: the origin of the vehicle's EKF; None until it is reported, also after each beginning.
        workspace_origin: the workspace's; without a place on earth it stays at the vehicle's first origin, wherever a
            reboot moves that to. None until it is known.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        time_sync: TimeSync,
        authority: Authority,
        setpoints: Setpoints,
        config: MavlinkConfig,
        promised: Capabilities,
        judged: JudgedParameters,
    ) -> None:
        self._vehicle: Final = vehicle
        self._time_sync: Final = time_sync
        self._authority: Final = authority
        self._setpoints: Final = setpoints
        self._lists: Final = ItemLists(vehicle)
        self._ascent: Final = Ascent(vehicle, setpoints, config.height_m)
        self._fenced = -1
        self._config: Final = config
        self._promised: Final = promised
        self._judged: Final = judged
        self._lease_ms: Final = round(promised.lease_s * 1e3)
        self._steps: Iterator[str] = iter(())
        self._since_s = self._asked_s = self._kept_s = -math.inf
        self._keep_alive: Callable[[], None] | None = None
        self._named = KEEPER
        self._moves = "it does not say how fast it is"
        self._moved = ""
        self.origin: GeoPoint | None = None
        self.taken = self.ready = self.may_arm = self.armed_it = False
        self.waits_for = "everything"
        self.workspace_origin: GeoPoint | Projection | None = config.geo_origin
        self.begin()

    def begin(self) -> None:
        """Begin, or begin anew: earlier messages of the vehicle do not count."""
        self._moved = self.moved or self._moved
        self._since_s = self._vehicle.now_s
        self._ascent.begin()
        self.origin = None
        self.gated: bool | None = None
        self._vehicle.parameters.clear()
        self._authority.begin()
        # While the vehicle gets ready, the keeper itself sends its commands.
        self._named = KEEPER
        self._keep_alive = None
        self._steps = self._run()
        self.ready = False

    def step(self) -> bool:
        """Ask for what is missing, and return whether the vehicle is ready.

        Raises:
            RobotUnavailable: the vehicle cannot be commanded, or does not keep its promise.
        """
        if self._keep_alive is not None and self._vehicle.now_s - self._kept_s >= _KEEP_S:
            self._kept_s = self._vehicle.now_s
            self._keep_alive()
        try:
            self.waits_for = next(self._steps, "")
        except RobotUnavailable:
            # The steps cannot go on from here: the next call begins anew.
            self.begin()
            raise
        self.ready = not self.waits_for
        if self.ready:
            self._moved = ""
        return self.ready

    @property
    def only_to_arm(self) -> bool:
        """Whether it lacks nothing but to be armed, or to get where an armed vehicle has to be."""
        return self.may_arm or self.waits_for == _TURN

    @property
    def moved(self) -> str:
        """How far the EKF's origin has moved since the vehicle got ready, so that its places mean others; or empty."""
        said, before = self._vehicle.heard_since("GPS_GLOBAL_ORIGIN", self._since_s), self.origin
        if said is None or before is None or place_of(said) == before:
            return ""
        now = place_of(said)
        moved_m = math.hypot(*ArduPilotSphere(before).local(now.lat_deg, now.lon_deg), now.alt_m - before.alt_m)
        return f"the origin of its EKF has moved by {moved_m:.2f} m: "

    def why_again(self) -> str:
        """Return why it is made ready again, as far as that is known, and what is missing."""
        return f"{self._moved}it is made ready again, and lacks {self.why_not()}"

    def why_not(self) -> str:
        """Return what is missing, with the autopilot's own complaints."""
        vehicle = self._vehicle
        text, complaints = self.waits_for, vehicle.complaints(self._since_s)
        if vehicle.heartbeat is None and vehicle.link.strangers:
            text += f"; heard are the systems {sorted(vehicle.link.strangers)}"
        return f"{text}; it says: {complaints}" if complaints else text

    def _run(self) -> Iterator[str]:
        vehicle = self._vehicle
        yield from self._until(lambda: vehicle.heard_since("HEARTBEAT", self._since_s) is not None, "a heartbeat")
        kind = vehicle.kind
        if kind.name != self._config.vehicle:
            raise RobotUnavailable(
                f"it is a {kind.name}, and a {self._config.vehicle} was expected; set vehicle = '{kind.name}' in the "
                "backend's options"
            )
        self.taken = True
        for name, message_id in STREAMS.items():
            hz = yield from self._granted(name, message_id)
            yield from self._flows(name, hz)
        self._refuse_duplicates()
        for message_id in _SLOW_STREAMS:
            vehicle.ask_for(KEEPER, message_id, _SLOW_HZ)
        vehicle.ask_for(KEEPER, mav.MAVLINK_MSG_ID_GPS_RAW_INT, _GPS_HZ)
        if kind.is_px4:
            vehicle.ask_for(KEEPER, _PX4_EKF, _SLOW_HZ)
        yield from self._until(
            lambda: vehicle.heard_since("SYS_STATUS", self._since_s) is not None, "the state of its battery",
            lambda: vehicle.ask_for(KEEPER, mav.MAVLINK_MSG_ID_SYS_STATUS, _SLOW_HZ),
        )  # fmt: skip
        yield from self._until(
            lambda: vehicle.ekf_ready(self._since_s), "its EKF to know where it is",
            lambda: vehicle.ask_once(KEEPER, _PX4_EKF if kind.is_px4 else mav.MAVLINK_MSG_ID_EKF_STATUS_REPORT),
        )  # fmt: skip
        yield from wait_for_accuracy(vehicle, self._config.gps_accuracy_m)
        yield from self._until(
            self._heard_origin, "the origin of its EKF",
            lambda: vehicle.ask_once(KEEPER, mav.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN),
        )  # fmt: skip
        assert self.origin is not None
        assert self.workspace_origin is not None
        yield from judge_places(vehicle, self.origin, self._config, self._promised)
        yield from self._until(lambda: self._time_sync.settled, "its clock to be known")
        if vehicle.mode == kind.guided and vehicle.armed:
            # Leaving the mode drops the target that the vehicle has.
            yield from self._mode(kind.stop)
        if kind.is_px4:
            # PX4 takes targets only from a sender that has been sending them for a while, and goes on sending.
            self._keep_alive = self._stand
        yield from self._mode(kind.guided)
        if kind.is_px4:
            # It answers what it does not know by a result of its own, as a gate may.
            self.gated = False
        else:
            yield from self._until(self._knows_gate, "it to say whether it has a gate of its own", self._ask_for_gate)
        if not self.gated:
            yield from self._judge_parameters()
            if not kind.is_px4:
                # The vehicle's target, whoever sent it.
                yield from self._granted("POSITION_TARGET_GLOBAL_INT", mav.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT)
        reboots = self._time_sync.reboots
        if self._config.upload_fence and self._fenced != reboots:
            # Once after each boot: reading it back takes long, and a vehicle that was only silent still holds it.
            items = fence_items(self._config.workspace, self.workspace_origin)
            yield from put_up(vehicle, self._lists, items, self._parameter)
            self._fenced = reboots
        yield from self._until(lambda: self.may_arm, _TURN)
        # After a silence the vehicle may be flying already, at whatever height it was sent to. One that is not armed
        # stands on the ground, wherever its estimate has drifted to.
        grounded = not vehicle.armed or self._ascent.low
        yield from self._until(lambda: vehicle.armed, "it to arm", self._arm)
        if kind.flies and grounded:
            yield from self._fly()
        while not self._rests():
            yield f"it to stand still: {self._moves}"
        if self.gated:
            self._named = SENDERS[Controller.SC]
            yield from self._until(lambda: self._authority.reported() == self._named, "it to obey the safe controller")

    def _judge_parameters(self) -> Iterator[str]:
        """Refuse a vehicle whose own parameters do not allow the promise."""
        yield from self._told(self._judged.names)
        if why := self._judged.why_refused():
            raise RobotUnavailable(why)

    def _parameter(self, name: str) -> Generator[str, None, float | None]:
        """Ask for a parameter; return its value, or None if the vehicle does not answer."""
        yield from self._told((name,))
        return self._vehicle.parameters.get(name)

    def _told(self, names: Sequence[str]) -> Iterator[str]:
        """Ask for parameters; wait until the vehicle has reported them all, or for `_ANSWER_S`."""
        vehicle, until_s = self._vehicle, self._vehicle.now_s + _ANSWER_S
        for name in names:
            vehicle.parameters.pop(name, None)
        self._asked_s = -math.inf
        while (missing := [name for name in names if name not in vehicle.parameters]) and vehicle.now_s < until_s:
            if self._due():
                for name in missing:
                    vehicle.ask_parameter(KEEPER, name)
            yield f"an answer to what it is asked for ({', '.join(missing)})"

    def _fly(self) -> Iterator[str]:
        ascent, is_px4 = self._ascent, self._vehicle.kind.is_px4
        ascent.begin()
        if is_px4:
            self._keep_alive = ascent.climb
        yield from self._until(
            lambda: ascent.done, f"it to be {self._config.height_m:g} m up", None if is_px4 else ascent.rise
        )
        if is_px4:
            self._keep_alive = self._stand

    def _until(self, reached: Callable[[], bool], what: str, ask: Callable[[], None] | None = None) -> Iterator[str]:
        """Ask at intervals until a condition is met."""
        self._asked_s = -math.inf
        while not reached():
            if ask is not None and self._due():
                ask()
            yield what

    def _due(self) -> bool:
        now_s = self._vehicle.now_s
        if now_s - self._asked_s < RETRY_S:
            return False
        self._asked_s = now_s
        return True

    def _refuse_duplicates(self) -> None:
        vehicle = self._vehicle
        duplicate = vehicle.link.duplicates.get(vehicle.system)
        if duplicate is not None and duplicate.messages >= _DUPLICATE_MESSAGES and duplicate.last_s >= self._since_s:
            raise RobotUnavailable(f"{duplicate}; end one of them, or give it a system id of its own")

    def _granted(self, name: str, message_id: int) -> Generator[str, None, float]:
        """Ask for a message at a high rate, at lower rates if that is denied; return the granted rate."""
        vehicle, least_hz = self._vehicle, self._config.samples_hz
        hz = max(_ASKED_HZ, least_hz)
        while True:
            asked_s, ack = vehicle.now_s, None
            vehicle.ask_for(KEEPER, message_id, hz)
            while ack is None and vehicle.now_s - asked_s < RETRY_S:
                yield f"an answer to what it is asked for ({name})"
                ack = vehicle.ack(mav.MAV_CMD_SET_MESSAGE_INTERVAL, asked_s)
            if ack is not None and ack.accepted:
                return hz
            if ack is not None:
                if hz <= least_hz:
                    raise RobotUnavailable(
                        f"it does not send {name} {hz:g} times a second ({ack.name}); set a lower stream_hz, which "
                        "makes samples older"
                    )
                hz = max(hz * _SLOWER, least_hz)

    def _flows(self, name: str, hz: float) -> Iterator[str]:
        """Wait until a message comes at about the granted rate: some vehicles accept a request and do nothing."""
        inbox = self._vehicle.inbox
        while True:
            begun, began = inbox.latest.get(name), inbox.counts.get(name, 0)
            while begun is None or begun.received_s < self._since_s:
                yield f"{name}"
                begun, began = inbox.latest.get(name), inbox.counts.get(name, 0)
            count, passed_s = 0, 0.0
            while passed_s < _COUNTED_S:
                yield f"{name}: it has granted {hz:.0f} Hz, and sends {count / passed_s if passed_s else 0.0:.0f} Hz"
                count = inbox.counts[name] - began
                passed_s = (inbox.latest[name].message.time_boot_ms - begun.message.time_boot_ms) * 1e-3
                if passed_s < 0.0:
                    break
            if passed_s >= _COUNTED_S and count >= _FLOWING * hz * passed_s:
                return

    def _heard_origin(self) -> bool:
        said = self._vehicle.heard_since("GPS_GLOBAL_ORIGIN", self._since_s)
        if said is not None:
            self.origin = place_of(said)
            self.workspace_origin = self.workspace_origin or self.origin
        return said is not None

    def _mode(self, mode: int) -> Iterator[str]:
        vehicle = self._vehicle
        return self._until(
            lambda: vehicle.mode == mode,
            f"the mode {vehicle.kind.mode_name(mode)}",
            lambda: vehicle.set_mode(KEEPER, mode),
        )

    def _name(self) -> None:
        vehicle_s = self._time_sync.to_vehicle_s(self._vehicle.link.clock.now())
        if vehicle_s is not None:
            self._authority.name(self._named, vehicle_s)

    def _ask_for_gate(self) -> None:
        # Vehicles with a gate know the parameter and the message; others ignore both.
        self._vehicle.set_parameter(KEEPER, LEASE_PARAMETER, self._lease_ms)
        self._vehicle.ask_for(KEEPER, mav.MAVLINK_MSG_ID_NAMED_VALUE_INT, _REPORT_HZ)
        self._name()

    def _knows_gate(self) -> bool:
        supported = self._authority.supported(self._since_s)
        if supported:
            self.gated = True
            # Taking off needs a lease like any other motion.
            self._keep_alive = self._name
            lease_ms = self._vehicle.parameters.get(LEASE_PARAMETER)
            return self._authority.reported() == KEEPER and lease_ms == self._lease_ms
        self.gated = supported
        return supported is False

    def _arm(self) -> None:
        self.armed_it = True
        self._vehicle.command(KEEPER, mav.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)

    def _stand(self) -> None:
        self._setpoints.stand(Controller.SC)

    def _rests(self) -> bool:
        position = self._vehicle.heard_since("LOCAL_POSITION_NED", self._since_s)
        attitude = self._vehicle.heard_since("ATTITUDE", self._since_s)
        if position is None or attitude is None:
            return False
        speed_m_s = math.hypot(position.vx, position.vy, position.vz)
        # At rest the vehicle reports its estimate's noise; if that exceeds the promised noise, this waits for ever.
        rest_m_s, rest_rad_s = self._promised.speed_noise_m_s or 0.0, self._promised.rest_rad_s
        self._moves = (
            f"it shows {speed_m_s:.3f} m/s and {attitude.yawspeed:.3f} rad/s, allowed at rest: "
            f"promise.speed_noise_m_s = {rest_m_s:g}, and {rest_rad_s:.2g} rad/s"
        )
        return speed_m_s <= rest_m_s and abs(attitude.yawspeed) <= rest_rad_s
