#!/usr/bin/env bash
# Writes requirements/*.txt from pyproject.toml: `make lock`, or `make lock UPGRADE=1` for the newest versions.
#
# The locks hold for every supported Python and name no package index, so plain pip installs them from whichever
# index it is set up to use. There are no hashes: an index that builds its own wheels would not match them.
set -euo pipefail
cd "$(dirname "$0")/.."

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
python3 -m venv "$scratch/venv"
"$scratch/venv/bin/pip" install --quiet uv

cp -r requirements "$scratch/before"

compile() { # compile NAME UV_ARGUMENT...
    local name=$1
    shift
    "$scratch/venv/bin/uv" pip compile --quiet --universal --python-version 3.11 --no-emit-index-url --no-annotate \
        --custom-compile-command "make lock" ${UPGRADE:+--upgrade} --output-file "requirements/$name.txt" "$@"
    echo "wrote requirements/$name.txt"
}

# PyBullet has a lock of its own because pip can only build it, for minutes, where there is no wheel: an
# environment asks for it only where that is wanted.
"$scratch/venv/bin/python" - >"$scratch/pybullet.in" <<'PYTHON'
import sys

if sys.version_info < (3, 11):
    sys.exit("make lock needs Python 3.11 or newer as python3.")
import tomllib

with open("pyproject.toml", "rb") as file:
    print(*tomllib.load(file)["project"]["optional-dependencies"]["pybullet"], sep="\n")
PYTHON
compile pybullet "$scratch/pybullet.in"

# The largest first, so that the others take its versions and can share an environment.
test=(--group build --group test --group browser --group notebook)
for extra in ompl report film mavlink foxglove zenoh sign campaign cluster notebook worlds; do test+=(--extra "$extra"); done
compile check pyproject.toml "${test[@]}" --group lint --group docs --group release
for name in core demo docs test ros2; do
    case $name in
        core) arguments=() ;;
        # With what the README goes on to after the demo.
        demo) arguments=(--group build --extra ompl --extra report --extra mavlink --extra campaign --extra worlds) ;;
        docs) arguments=(--group build --group docs) ;;
        test) arguments=("${test[@]}") ;;
        # For an environment of its own, see tools/env.sh.
        ros2) arguments=(--group build --extra ompl --extra ros2 --extra zenoh --extra campaign --extra worlds --group test) ;;
    esac
    compile "$name" pyproject.toml --constraints requirements/check.txt "${arguments[@]}"
done

"$scratch/venv/bin/python" tools/lock_report.py "$scratch/before" requirements
