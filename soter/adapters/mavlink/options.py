"""Options of the backends `mavlink` and `mavsdk`, and the promise of their vehicles."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

from pydantic import BaseModel, Field, field_validator, model_validator

from soter.adapters.mavlink.frames import NORTHMOST_DEG, GeoPoint
from soter.adapters.mavlink.transport import Address
from soter.geometry.earth import Projection
from soter.geometry.site import GeoOrigin, Site
from soter.onboard.drive import DriveLimits, tube_m
from soter.sdk import BackendConfig, Capabilities

Positive = Annotated[float, Field(gt=0.0, le=1e6, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]

ROVER: Final = Capabilities(
    in_process=False,
    deterministic=False,
    reverses=True,
    reports_battery=True,
    reports_controller=True,
    v_max_m_s=0.22,
    yaw_rate_max_rad_s=2.84,
    brake_m_s2=1.0,
    body_radius_m=0.105,
    latency_s=0.02,
    sample_age_s=0.054,
    jitter_s=0.03,
    setpoint_period_s=0.02,
    lease_s=0.15,
    tube_m=0.02,
    overshoot_m=0.01,
    position_noise_m=0.003,
    speed_noise_m_s=0.01,
    pivots_first=True,
)
"""The simulated rover's promise in real time; its control and stream periods are added to the times."""

COPTER: Final = replace(ROVER, brake_m_s2=2.0, yaw_rate_max_rad_s=1.5, pivots_first=False)
"""The simulated copter's promise, likewise."""

BOAT: Final = replace(ROVER, tube_m=0.9, position_noise_m=0.9, speed_noise_m_s=0.1)
"""The simulated boat's promise, likewise: it drifts where it stands."""

STREAM_HZ: Final = 50.0

VEHICLES: Final = {"rover": ROVER, "copter": COPTER, "boat": BOAT}

_BODIES_HZ: Final = 20.0
_HOST_TIMES: Final = ("latency_s", "sample_age_s", "jitter_s")


class Origin(BaseModel, extra="forbid", frozen=True):
    """The workspace's origin on earth."""

    lat_deg: Annotated[float, Field(ge=-90.0, le=90.0)]
    lon_deg: Annotated[float, Field(ge=-180.0, le=180.0)]
    alt_m: Annotated[float, Field(ge=-1000.0, le=10_000.0)] = 0.0


class Voltage(BaseModel, extra="forbid", frozen=True):
    """The voltages of a full and an empty battery, for autopilots that do not count the charge.

    Attributes:
        empty_v: the charge is 0 at or below it.
        full_v: the charge is 1 at or above it.
    """

    empty_v: Positive
    full_v: Positive

    @model_validator(mode="after")
    def _rises(self) -> Self:
        if not self.empty_v < self.full_v:
            raise ValueError(f"empty_v is {self.empty_v}, allowed: below full_v = {self.full_v}")
        return self


class MavlinkConfig(BackendConfig):
    """Options of the backends `mavlink` and `mavsdk`.

    Attributes:
        connection: address of the vehicles; None starts simulated vehicles, and ends them with the run.
        truth: address, as host:port, of the ground truth of a simulator that was started by hand.
        vehicle: the kind of vehicle.
        system_id: our system id; an ArduPilot heeds only the heartbeats of its SYSID_MYGCS, 255 by default.
        passphrase_file: a file whose first line signs every message; messages without this signature are dropped.
        unsigned: whether a connection that leaves this host may go without signing.
        origin: of a workspace in metres; None for the origin of each vehicle's EKF.
        height_m: height of the workspace's plane z = 0, in which copters fly, above the EKF's origin.
        stream_hz: rate of the samples; a vehicle that grants less is refused.
        speedup: vehicle seconds per host second; for simulated vehicles only.
        engine: of the simulated vehicles that are started; None with a connection.
        boot_s: vehicle time until these vehicles are ready.
        on_close: what copters do at the end, after they have stopped.
        promise: differences from the simulated vehicles; `latency_s`, `sample_age_s` and `jitter_s` are those of link
            and host, in host seconds: the vehicle's control period and the period of its samples are added.
        voltage: for autopilots that do not count the charge.
        gps_accuracy_m: how far off a vehicle's GPS may say that it is; None for twice what it says when it is ready.
        upload_fence: whether to upload the workspace to each vehicle as its own fence, and enable it.
    """

    connection: str | None = None
    truth: str | None = None
    vehicle: Literal["rover", "copter", "boat"] = "rover"
    system_id: Annotated[int, Field(ge=1, le=255)] = 255
    passphrase_file: Path | None = None
    unsigned: bool = False
    origin: Origin | None = None
    height_m: Positive = 1.5
    stream_hz: Annotated[float, Field(ge=4.0, le=200.0)] = STREAM_HZ
    speedup: Positive = 1.0
    engine: Literal["kinematic", "pybullet"] | None = None
    boot_s: NotNegative = 1.0
    on_close: Literal["land", "hold"] = "land"
    voltage: Voltage | None = None
    gps_accuracy_m: Positive | None = None
    upload_fence: bool = False

    @model_validator(mode="before")
    @classmethod
    def _moves_what_is_simulated(cls, given: Any) -> Any:
        if not isinstance(given, dict):
            return given
        if given.get("connection") is None:
            return {"engine": "kinematic", **given}
        if given.get("engine") is not None:
            raise ValueError("engine is for simulated vehicles; leave it out where a connection to others is given")
        return given

    @field_validator("connection")
    @classmethod
    def _is_address(cls, text: str | None) -> str | None:
        if text is not None:
            Address.parse(text)
        return text

    @field_validator("truth")
    @classmethod
    def _stays_here(cls, text: str | None) -> str | None:
        if text is not None and not Address.parse(f"tcp:{text}").is_local:
            raise ValueError("allowed: 127.0.0.1:PORT; the truth is told on the simulator's own host only")
        return text

    @model_validator(mode="after")
    def _is_signed(self) -> Self:
        if self.connection is not None and self.passphrase_file is None and not self.unsigned:
            address = Address.parse(self.connection)
            if not address.is_local:
                raise ValueError(
                    f"connection '{address}' leaves this host and nothing is signed, so that anybody there could "
                    "command the vehicles; set passphrase_file, or unsigned = true where the network itself is closed"
                )
        return self

    @model_validator(mode="after")
    def _knows_the_place(self) -> Self:
        earth = self._earth
        if earth is not None and self.origin is not None:
            raise ValueError("origin is given, and the workspace says itself where on earth it is; leave origin out")
        if earth is not None and abs(earth.lat_deg) > NORTHMOST_DEG:
            raise ValueError(
                f"the workspace's origin is at latitude {earth.lat_deg:g}, where meridians are too close for what "
                f"autopilots reckon by; allowed: {NORTHMOST_DEG:g} north to {NORTHMOST_DEG:g} south"
            )
        return self

    @model_validator(mode="after")
    def _has_a_fence(self) -> Self:
        if self.upload_fence and self.workspace.outlines() == (None, []):
            raise ValueError(
                "upload_fence is true, and the workspace has neither an outer boundary nor keep-out areas; set it false"
            )
        return self

    def read_passphrase(self) -> str | None:
        """Return the passphrase, or None if nothing is signed.

        Raises:
            OSError: the file cannot be read.
            ValueError: the file has no passphrase.
        """
        if self.passphrase_file is None:
            return None
        lines = self.passphrase_file.read_text(encoding="utf-8").splitlines()
        if not lines or not lines[0].strip():
            raise ValueError(f"passphrase_file '{self.passphrase_file}' has no passphrase in its first line")
        return lines[0].strip()

    @property
    def _earth(self) -> GeoOrigin | None:
        return self.workspace.plan.origin if isinstance(self.workspace, Site) else None

    @property
    def geo_origin(self) -> GeoPoint | Projection | None:
        """The workspace's origin on earth, or the workspace's projection if it has places on earth."""
        if self._earth is not None:
            return Projection(self._earth, "workspace")
        origin = self.origin
        return None if origin is None else GeoPoint(origin.lat_deg, origin.lon_deg, origin.alt_m)

    def promised(self) -> Capabilities:
        """Return the vehicles' promise; times are in fleet time, `speedup` seconds of which pass in a host second."""
        base = VEHICLES[self.vehicle]
        if self.has_bodies:
            base = replace(base, setpoint_period_s=1.0 / _BODIES_HZ)
        given = self.promise.given
        asked = replace(base, **given)
        limits = DriveLimits(asked.v_max_m_s, brake_m_s2=asked.brake_m_s2)
        strays_m = tube_m(limits, asked.latency_s + asked.setpoint_period_s)
        if self.vehicle == "boat":
            strays_m = max(strays_m, base.tube_m)
        return _with_periods(replace(asked, **{"tube_m": strays_m, **given}), self.samples_hz, self.speedup)

    @property
    def has_bodies(self) -> bool:
        """Whether the vehicles are simulated as rigid bodies, with fewer control periods per second."""
        return self.connection is None and self.engine == "pybullet"

    @property
    def samples_hz(self) -> float:
        """Samples per second: as many as requested, at most one per control period."""
        return min(self.stream_hz, _BODIES_HZ) if self.has_bodies else self.stream_hz


def simulated(vehicle: str) -> Capabilities:
    """Return a simulated vehicle's promise in real time."""
    return _with_periods(VEHICLES[vehicle], STREAM_HZ, 1.0)


def _with_periods(base: Capabilities, stream_hz: float, speedup: float) -> Capabilities:
    times = {name: getattr(base, name) * speedup for name in _HOST_TIMES}
    times["latency_s"] += base.setpoint_period_s
    times["sample_age_s"] += 1.0 / stream_hz
    return replace(base, **times)
