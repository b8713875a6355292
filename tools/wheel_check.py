"""Builds the wheel and tries it as a user would get it: `make wheel-check`.

The wheel goes into a new environment outside the work tree, with the locked core dependencies and no extras.
There a file that is not packaged, or an import of a library that only an extra brings, shows up.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import venv
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = {"soter": ROOT / "soter", "soter_sim": ROOT / "sim" / "soter_sim"}
PIP = ("-m", "pip", "--quiet", "--disable-pip-version-check")
SUFFIXES = {".py", ".typed", ".css", ".html", ".in", ".js", ".json", ".toml", ".urdf", ".xml"}


def run(*command: str | Path, cwd: Path) -> str:
    """Runs a command to its end and returns what it printed; ends this program if it fails."""
    done = subprocess.run([str(part) for part in command], cwd=cwd, capture_output=True, text=True)
    if done.returncode != 0:
        shown = " ".join(str(part) for part in command)
        sys.exit(f"wheel check: `{shown}` failed with {done.returncode}:\n{done.stdout}{done.stderr}")
    return done.stdout


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


def main() -> None:
    """Builds, inspects, installs and runs the wheel."""
    with tempfile.TemporaryDirectory() as name:
        scratch = Path(name)
        run(sys.executable, *PIP, "wheel", "--no-deps", "--wheel-dir", scratch, ROOT, cwd=scratch)
        wheel = next(scratch.glob("soter_rta-*.whl"))
        found = complaints(wheel)
        if found:
            sys.exit("wheel check: " + "\n             ".join(found))

        venv.create(scratch / "venv", with_pip=True)
        bin_folder = scratch / "venv" / "bin"
        python = bin_folder / "python"
        run(python, *PIP, "install", "-r", ROOT / "requirements" / "core.txt", cwd=scratch)
        run(python, *PIP, "install", "--no-deps", wheel, cwd=scratch)
        run(python, *PIP, "check", cwd=scratch)
        run(python, "-W", "error", "-c", "import soter, soter_sim", cwd=scratch)
        soter = bin_folder / "soter"
        if wheel.name.split("-")[1] not in (said := run(soter, "--version", cwd=scratch)):
            sys.exit(f"wheel check: `soter --version` of {wheel.name} says {said!r}")
        print(run(soter, "backends", cwd=scratch), end="")
        print(f"wheel check: {wheel.name} is complete and runs without extras")


if __name__ == "__main__":
    main()
