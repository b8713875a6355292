"""A vehicle of strings for every test that asks for one."""

from __future__ import annotations

import pytest

from tests.adapters.mavlink.puppet import HostTime, Puppet


@pytest.fixture
def puppet() -> Puppet:
    """A vehicle that lives while the adapter sleeps."""
    return Puppet(HostTime())
