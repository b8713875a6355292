"""What a mission file may say of what robots promise: `[backends.NAME.promise]` for all, `[robots.N]` for one.

One model, whatever the backend. Figures that are not given are those that the backend declares.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Final, Self

from pydantic import Field, TypeAdapter, ValidatorFunctionWrapHandler, model_serializer, model_validator
from pydantic_core.core_schema import SerializerFunctionWrapHandler

from soter.config.table import RobotId, Table, wrong

Speed = Annotated[float, Field(ge=0.01, le=1000.0, allow_inf_nan=False)]
"""Nothing that is driven or braked with is as small as a float can be: quotients would be infinite."""

Length = Annotated[float, Field(ge=0.0, le=100.0, allow_inf_nan=False)]
Radius = Annotated[float, Field(ge=0.001, le=100.0, allow_inf_nan=False)]
Wait = Annotated[float, Field(ge=0.0, le=60.0, allow_inf_nan=False)]
Period = Annotated[float, Field(ge=0.001, le=60.0, allow_inf_nan=False)]
Noise = Annotated[float, Field(ge=0.0, le=100.0, allow_inf_nan=False)]


class Promise(Table):
    """What robots promise, as far as it is not what their backend declares; see `soter.sdk.Capabilities`.

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
    """The robots of a mission: how many of the workspace's, and what each promises that is unlike the others.

    A number alone, `robots = 2`, is the same as `count = 2`.

    Attributes:
        count: only the first so many of the workspace, or None for all.
    """

    count: RobotId | None = None
    __pydantic_extra__: dict[str, Promise]

    others: ClassVar[type[Promise]] = Promise
    """What all other keys are tables of: the robots, by id."""

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
