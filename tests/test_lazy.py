"""Packages whose names are loaded when they are first used have them all the same."""

from __future__ import annotations

import importlib
import subprocess
import sys

import pytest


@pytest.mark.parametrize("package", ["soter", "soter.config", "soter.runner", "soter.sdk"])
def test_what_a_package_names_is_listed_and_loaded(package: str) -> None:
    # In a process of its own nothing is loaded yet.
    listed = subprocess.run(
        [sys.executable, "-c", f"import {package}; print(*dir({package}))"], capture_output=True, text=True, check=True
    )
    module = importlib.import_module(package)
    assert {*module.__all__} == {*listed.stdout.split()}
    assert all(getattr(module, name) is not None for name in module.__all__)
    with pytest.raises(AttributeError, match=f"module '{package}' has no attribute 'Nonsense'"):
        module.Nonsense  # noqa: B018 - that is what fails
