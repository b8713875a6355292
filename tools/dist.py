"""Builds what is released, and tries it as a user would get it: `make dist`.

The wheel is built from the source distribution, so that one shows what the other lacks. Both are installed in turn into
a new environment outside the work tree, with the locked core dependencies and no extras. There a file that is not
packaged, or an import of a library that only an extra brings, shows up. Last comes the wheel with its small extras.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import venv
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = {"soter": ROOT / "soter", "soter_sim": ROOT / "sim" / "soter_sim"}
# What the lines `pip install -e ".[...]"` of the pages install and is small; `make install-check` has pip resolve all.
EXTRAS = ("foxglove", "sign", "zenoh")
SUFFIXES = {".py", ".typed", ".css", ".html", ".in", ".js", ".json", ".toml", ".xml"}


def run(*command: str | Path, cwd: Path) -> str:
    """Runs a command to its end and returns what it printed; ends this program if it fails."""
    # What is tried is what was built, and not a work tree that the caller has on Python's path.
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run([str(part) for part in command], cwd=cwd, capture_output=True, text=True, env=environment)
    if done.returncode != 0:
        shown = " ".join(str(part) for part in command)
        sys.exit(f"dist: `{shown}` failed with {done.returncode}:\n{done.stdout}{done.stderr}")
    return done.stdout


def pip(python: Path, *arguments: str | Path, cwd: Path) -> None:
    """Has this environment's pip work on that of another Python, which need not have one."""
    run(sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", "--python", python, *arguments, cwd=cwd)


def install(python: Path, *what: str | Path, cwd: Path) -> None:
    """Installs what is named. Of hundreds of modules few are imported here: the others need not be compiled."""
    pip(python, "install", "--no-compile", *what, cwd=cwd)


def packaged_files() -> set[str]:
    """The files of the work tree that belong into the wheel, under the names they have there."""
    return {
        f"{package}/{path.relative_to(folder).as_posix()}"
        for package, folder in PACKAGES.items()
        for path in folder.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }


def complaints(wheel: Path) -> list[str]:
    """What is wrong with the list of files in a wheel."""
    with zipfile.ZipFile(wheel) as archive:
        files = {name for name in archive.namelist() if ".dist-info/" not in name}
    wanted = packaged_files()
    unwanted = {name for name in files if Path(name).suffix not in SUFFIXES}
    return (
        [f"{name} is missing from the wheel" for name in sorted(wanted - files)]
        + [f"{name} is in the wheel but not in a package" for name in sorted(files - wanted)]
        + [f"{name} is of a kind that no package should hold" for name in sorted(unwanted)]
        + [f"{name}/py.typed is missing" for name in PACKAGES if f"{name}/py.typed" not in files]
    )


def build(folder: Path) -> tuple[Path, Path]:
    """Builds the source distribution and, from it, the wheel; returns them once their contents are in order."""
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", folder, ROOT, cwd=folder)
    sdist, wheel = next(folder.glob("soter_rta-*.tar.gz")), next(folder.glob("soter_rta-*.whl"))
    found = complaints(wheel)
    if found:
        sys.exit("dist: " + "\n      ".join(found))
    run(sys.executable, "-m", "twine", "check", "--strict", sdist, wheel, cwd=folder)
    # Two packages of one distribution is what is meant: the simulation has a name of its own.
    run(sys.executable, "-m", "check_wheel_contents", "--toplevel", ",".join(PACKAGES), wheel, cwd=folder)
    return sdist, wheel


def tag_problem(tags: list[str], version: str) -> str | None:
    """Why what was built must not be released under the tags of its commit; None if it may."""
    of_versions = [tag for tag in tags if tag[:1] == "v" and tag[1:2].isdigit()]
    wrong = [tag for tag in of_versions if tag != f"v{version}"]
    return f"this commit is tagged {', '.join(wrong)}, but its version is {version}" if wrong else None


def smoke(python: Path, archive: Path, scratch: Path) -> str:
    """Installs an archive, uses it without extras, and takes it away again; returns what its backends say."""
    install(python, "--no-deps", archive, cwd=scratch)
    pip(python, "check", cwd=scratch)
    run(python, "-W", "error", "-c", "import soter, soter_sim; [getattr(soter, n) for n in soter.__all__]", cwd=scratch)
    soter = python.with_name("soter")
    version = archive.name.removesuffix(".tar.gz").split("-")[1]
    if version not in (said := run(soter, "--version", cwd=scratch)):
        sys.exit(f"dist: `soter --version` of {archive.name} says {said!r}")
    backends = run(soter, "backends", cwd=scratch)
    patrol = ("--duration", "2", "--backend", "kinematic", "--planner", "straight-line", "--no-record", "--quiet")
    run(soter, "run", "--mission", "surveillance", *patrol, cwd=scratch)
    pip(python, "uninstall", "--yes", "soter-rta", cwd=scratch)
    left = [path for package in PACKAGES for path in python.parents[1].glob(f"lib/*/site-packages/{package}")]
    if left:
        sys.exit(f"dist: of {archive.name} there is left when it is uninstalled: {left}")
    return backends


def extras(python: Path, wheel: Path, scratch: Path) -> None:
    """Installs a wheel with the extras that are small, and imports all that they are there for."""
    locked = ROOT / "requirements" / "check.txt"
    install(python, "--constraint", locked, f"{wheel}[{','.join(EXTRAS)}]", cwd=scratch)
    pip(python, "check", cwd=scratch)
    brought = f"[import_module(name) for name, extra in INSTALL_HINTS.items() if extra in {EXTRAS}]"
    run(
        python,
        "-c",
        f"from importlib import import_module; from soter.registry import INSTALL_HINTS; {brought}",
        cwd=scratch,
    )


def main() -> None:
    """Builds, inspects, installs and runs wheel and source distribution; keeps them if told where."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--into", type=Path, metavar="DIR", help="where the two are kept; nowhere if not given")
    into: Path | None = parser.parse_args().into
    with tempfile.TemporaryDirectory() as name:
        scratch = Path(name)
        archives = build(scratch)
        tags = run("git", "tag", "--points-at", "HEAD", cwd=ROOT).split() if (ROOT / ".git").exists() else []
        if problem := tag_problem(tags, archives[1].name.split("-")[1]):
            sys.exit(f"dist: {problem}")
        venv.create(scratch / "venv")
        python = scratch / "venv" / "bin" / "python"
        install(python, "--no-deps", "-r", ROOT / "requirements" / "core.txt", cwd=scratch)
        backends = ""
        for archive in archives:
            backends = smoke(python, archive, scratch)
            print(f"dist: {archive.name} is complete and runs without extras")
        extras(python, archives[1], scratch)
        print(f"dist: {archives[1].name} brings {', '.join(EXTRAS)}")
        print(backends, end="")
        if into is not None:
            into.mkdir(exist_ok=True)
            for archive in archives:
                (into / archive.name).write_bytes(archive.read_bytes())
                print(f"dist: {into / archive.name}")


if __name__ == "__main__":
    main()
