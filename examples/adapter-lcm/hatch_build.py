"""Lets lcm-gen write the Python of `messages.lcm` where the distribution is built."""

from __future__ import annotations

import subprocess
from typing import Any

from hatchling.builders.config import BuilderConfig
from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class TypesHook(BuildHookInterface[BuilderConfig]):
    """What Hatchling calls before it collects the files."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        subprocess.run(["lcm-gen", "-p", "--ppath", ".", "soter_lcm/messages.lcm"], cwd=self.root, check=True)
        build_data["artifacts"].append("/soter_lcm/types/")
