"""Options of backends: what a backend does not know is refused."""

from __future__ import annotations

import pytest
from pydantic import BaseModel, ConfigDict

from soter.sdk import BackendConfig


@pytest.mark.parametrize("extra", ["ignore", "allow"])
def test_no_backend_accepts_options_that_it_does_not_know(extra: str) -> None:
    with pytest.raises(TypeError, match=f"extra = '{extra}'"):
        type("Loose", (BackendConfig,), {"model_config": ConfigDict(extra=extra), "__module__": __name__})  # type: ignore[typeddict-item]


class Place(BaseModel):
    """A table of a backend's that says nothing of options it does not know."""

    port: int


def test_no_table_of_a_backend_does() -> None:
    with pytest.raises(TypeError, match="of Place has extra = 'ignore'"):

        class Placed(BackendConfig):
            robots: dict[int, Place | None]


def test_a_backend_may_set_anything_else() -> None:
    class Titled(BackendConfig):
        model_config = ConfigDict(title="titled")

    assert Titled.model_config["extra"] == "forbid"
