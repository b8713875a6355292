"""Makes the tree that is to be tagged: `make release VERSION=0.2.0`.

The version stands in the package, the citation and the ROS package; all of them are set, and the fragments in changes/
become a part of CHANGELOG.md. Nothing is committed, tagged or uploaded. `make dist` refuses a tag that says otherwise.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]
PLACES: Final = {
    "soter/__init__.py": r'(?<=__version__ = ")[^"]+',
    "CITATION.cff": r"(?<=^version: ).+$",
    "ros/soter/package.xml": r"(?<=<version>)[^<]+",
    "ros/soter/setup.py": r'(?<=version=")[^"]+',
}
"""Where the version stands."""


def set_version(root: Path, version: str) -> None:
    """Writes a version wherever it stands.

    Raises:
        ValueError: it is no version, or does not stand where it should; nothing is written then.
    """
    if not re.fullmatch(r"\d+\.\d+\.\d+((a|b|rc)\d+)?", version):
        raise ValueError(f"VERSION is '{version}', allowed: such as 0.2.0 or 0.2.0rc1")
    texts = {}
    for name, pattern in PLACES.items():
        text, count = re.subn(pattern, version, (root / name).read_text(encoding="utf-8"), flags=re.MULTILINE)
        if count != 1:
            raise ValueError(f"{name} has {count} versions, allowed: 1")
        texts[name] = text
    for name, text in texts.items():
        (root / name).write_text(text, encoding="utf-8")


def main() -> None:
    """Sets the version, writes the changelog, and says what is left to do."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("version", help="such as 0.2.0 or 0.2.0rc1")
    version: str = parser.parse_args().version
    try:
        set_version(ROOT, version)
    except ValueError as refused:
        sys.exit(f"release: {refused}")
    subprocess.run([sys.executable, "-m", "towncrier", "build", "--yes", "--version", version], cwd=ROOT, check=True)
    # What was written there by hand, before there were fragments, is a part of this release.
    log = ROOT / "CHANGELOG.md"
    log.write_text(log.read_text(encoding="utf-8").replace("## Unreleased\n\n", ""), encoding="utf-8")
    print(f'Next: make check; git commit -am "Release {version}"; git tag v{version}; make dist')


if __name__ == "__main__":
    main()
