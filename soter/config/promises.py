"""Robots' promises in a mission file: `[backends.NAME.promise]` for all, `[robots.N]` for one.

The model is the same for all backends. Figures that are not given are those that the backend declares.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Final, Self

from pydantic import Field, TypeAdapter, ValidatorFunctionWrapHandler, model_serializer, model_validator
from pydantic_core.core_schema import SerializerFunctionWrapHandler

from soter.config.table import RobotId, Table, wrong

Speed = Annotated[float, Field(ge=0.01, le=1000.0, allow_inf_nan=False)]
"""A speed or deceleration, with a lower bound that keeps quotients finite."""

Length = Annotated[float, Field(ge=0.0, le=100.0, allow_inf_nan=False)]
Radius = Annotated[float, Field(ge=0.001, le=100.0, allow_inf_nan=False)]
Wait = Annotated[float, Field(ge=0.0, le=60.0, allow_inf_nan=False)]
Period = Annotated[float, Field(ge=0.001, le=60.0, allow_inf_nan=False)]
Noise = Annotated[float, Field(ge=0.0, le=100.0, allow_inf_nan=False)]


class Promise(Table):
    """Promises of robots that differ from what their backend declares; see `soter.sdk.Capabilities`.

    A backend may narrow this by a subclass, for figures that its robots cannot keep.
    """

    v_max_m_s: Speed | None = None
    yaw_rate_max_rad_s: Speed | None = None
    brake_m_s2: Speed | None = None
    accel_m_s2: Speed | None = None
    body_radius_m: Radius | None = None
    latency_s: Wait | None = None
    sample_age_s: Wait | None = None
    jitter_s: Wait | None = None
    setpoint_period_s: Period | None = None
    lease_s: Period | None = None
    tube_m: Length | None = None
    overshoot_m: Length | None = None
    position_noise_m: Length | None = None
    speed_noise_m_s: Noise | None = None
    heading_noise_rad: Noise | None = None
    reverses: bool | None = None
    pivots_first: bool | None = None

    @property
    def given(self) -> dict[str, Any]:
        """The figures that are given, by name."""
        return {name: value for name, value in self if value is not None}


_COUNT: Final[TypeAdapter[int]] = TypeAdapter(RobotId)


class RobotsTable(Table, extra="allow"):
    """The robots of a mission: how many of the workspace's take part, and the promises of single ones.

    A number alone, `robots = 2`, is short for `count = 2`.

    Attributes:
        count: number of the workspace's robots, from the first, that take part; None for all.
    """

    count: RobotId | None = None
    __pydantic_extra__: dict[str, Promise]

    others: ClassVar[type[Promise]] = Promise
    """The model of all other keys, which are tables of single robots by id."""

    @property
    def promises(self) -> dict[int, Promise]:
        """The promises of single robots, by id."""
        return {int(name): promise for name, promise in self.__pydantic_extra__.items()}

    @model_validator(mode="wrap")
    @classmethod
    def _number_or_table(cls, value: object, handler: ValidatorFunctionWrapHandler) -> Self:
        if not isinstance(value, Mapping | RobotsTable):
            return cls(count=None if value is None else _COUNT.validate_python(value, strict=True))
        table: Self = handler(value)
        for name in table.__pydantic_extra__:
            if not re.fullmatch(r"[1-9][0-9]{0,2}", name):
                raise wrong((name,), name, "count, or the id of a robot, as in [robots.2]")
        return table

    @model_serializer(mode="wrap")
    def _number_where_it_will_do(self, handler: SerializerFunctionWrapHandler) -> Any:
        return handler(self) if self.__pydantic_extra__ else self.count
