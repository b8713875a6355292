"""What the pages install can be had; `make install-check` has pip and apt say so too.

The ROS package is held to the distribution: the same version, all its launch files, and programs that there are.
"""

from __future__ import annotations

import ast
import os
import re
import subprocess
import tomllib
from functools import cache
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from defusedxml.ElementTree import parse as parse_xml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import soter
from soter.cli.new import check_name
from soter.registry import INSTALL_HINTS
from tests.project.source import ROOT
from tools.install_lines import Line, lines

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
# Of somebody else, on the index of Python packages.
FOREIGN = {"MAVProxy", "duckdb", "pre-commit"}
ROS = ROOT / "ros" / "soter"
bringers = cache(packages_distributions)


@pytest.mark.parametrize(
    "line", [line for line in lines() if line.words[0] == "pip"], ids=lambda line: " ".join(line.words)
)
def test_what_a_page_installs_is_there(line: Line) -> None:
    what = line.words[-1]
    path, _, extras = what.partition("[")
    if made := re.fullmatch(r"soter-([a-z_]+)", what):
        check_name(made[1])  # of `soter new adapter`
        assert f"soter new adapter {made[1]}" in (ROOT / line.page).read_text()
        return
    assert what in FOREIGN or (ROOT / path / "pyproject.toml").is_file(), f"{line.page}: nobody can install {what}"
    assert set(filter(None, extras.rstrip("]").split(","))) <= set(PROJECT["optional-dependencies"])


# The wheels of ROS 2 are in an environment of their own.
@pytest.mark.parametrize(("library", "extra"), [hint for hint in INSTALL_HINTS.items() if hint[1] != "ros2"])
def test_an_extra_brings_the_library_for_which_it_is_named(library: str, extra: str) -> None:
    distributions = bringers().get(library)
    if not distributions:
        pytest.skip(f"{library} is not installed here")
    named = {canonicalize_name(Requirement(each).name) for each in PROJECT["optional-dependencies"][extra]}
    assert {canonicalize_name(name) for name in distributions} & named


def test_python_is_the_one_that_is_named() -> None:
    """Each job of the matrix hands its own on: else a 3.11 anywhere on the path would be taken in all of them."""
    assert "PYTHON: python${{ matrix.python }}" in (ROOT / ".github/workflows/ci.yml").read_text()
    named = {**os.environ, "PYTHON": "python3.0"}
    made = subprocess.run([ROOT / "tools/env.sh", "test"], env=named, capture_output=True, text=True, check=False)
    assert made.returncode == 1
    assert "PYTHON=python3.0" in made.stderr


def test_the_package_of_ros_is_this_version() -> None:
    package = parse_xml(ROS / "package.xml").getroot()
    assert package is not None
    setup = (ROS / "setup.py").read_text()
    assert package.findtext("version") == soter.__version__
    assert f'version="{soter.__version__}"' in setup
    assert package.findtext("name") == "soter"
    needed = {each.text for each in package.findall("exec_depend")}
    wheels = PROJECT["optional-dependencies"]["ros2"]
    assert {wheel.removeprefix("ros-jazzy-").replace("-", "_") for wheel in wheels} - {"rmw_fastrtps_cpp"} <= needed


@pytest.mark.parametrize("path", sorted((ROS / "launch").glob("*.py")), ids=lambda path: path.name)
def test_launch_files_start_programs_that_there_are(path: Path) -> None:
    tree = ast.parse(path.read_text())
    assert any(isinstance(node, ast.FunctionDef) and node.name == "generate_launch_description" for node in tree.body)
    [command] = [node.value for node in ast.walk(tree) if isinstance(node, ast.keyword) and node.arg == "cmd"]
    assert isinstance(command, ast.List)
    program = command.elts[0]
    assert isinstance(program, ast.Constant)
    assert program.value in PROJECT["scripts"]


@pytest.mark.parametrize("path", sorted((ROOT / "docker").glob("*Dockerfile")), ids=lambda path: path.name)
def test_images_are_made_of_what_there_is(path: Path) -> None:
    text = path.read_text().replace("\\\n", " ")
    copied = [words.split()[:-1] for words in re.findall(r"^COPY (?!--from)(.+)$", text, re.MULTILINE)]
    assert copied
    let_in = {line[1:] for line in (ROOT / ".dockerignore").read_text().splitlines() if line.startswith("!")}
    for source in (name for names in copied for name in names):
        assert (ROOT / source).exists()
        assert source.split("/")[0] in let_in
    assert all((ROOT / name).is_file() for name in re.findall(r"-c ([\w/.-]+)", text))
    [extras] = re.findall(r"\"\.\[(.+)\]\"", text)
    assert {*extras.split(",")} <= {*PROJECT["optional-dependencies"]}
    assert "\nSHELL" not in text  # Podman builds images of a format that has none, and goes on in another shell.
    # Every example that stands in the image has what it needs.
    assert {"ompl", "worlds", "campaign"} <= {*extras.split(",")}
