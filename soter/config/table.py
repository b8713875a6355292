"""The base of all tables of a mission file."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, PlainValidator, TypeAdapter, ValidationError
from pydantic_core import InitErrorDetails

from soter.geometry.workspace import MAX_ROBOT_ID
from soter.problems import not_allowed

Name = Annotated[str, Field(min_length=1)]
RobotId = Annotated[int, Field(ge=1, le=MAX_ROBOT_ID)]


class Table(BaseModel):
    """Base of all tables: unknown keys are refused, and values are not converted."""

    # Strict: "600" is no number and 1 is no bool; a slip is reported instead of guessed at.
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


def wrong(key: tuple[str | int, ...], value: object, allowed: str) -> ValidationError:
    """Return an error on a key below the model that is being validated."""
    details = InitErrorDetails(type=not_allowed(allowed), loc=key, input=value)
    return ValidationError.from_exception_data("mission", [details])


def table_or_list(table: type[Table], of: Any) -> PlainValidator:
    """Return what validates a value that is a table or a list of something, by what it is.

    A union is tried both ways, and what it says has keys that no file has.
    """
    items: TypeAdapter[Any] = TypeAdapter(Annotated[list[of], Field(min_length=1)])

    def check(value: object) -> object:
        if isinstance(value, dict):
            return table.model_validate(value)
        if isinstance(value, list):
            return items.validate_python(value, strict=True)
        if isinstance(value, table):
            return value
        raise not_allowed(f"a table of {', '.join(table.model_fields)}, or a list")

    return PlainValidator(check)
