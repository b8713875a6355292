#!/usr/bin/env bash
# Makes .venv hold what requirements/NAME.txt locks, and the project itself, editable: tools/env.sh NAME...
#
# All locks agree on versions, so one environment serves the demo, the tests and the checks; each adds to it.
# Stamps in .venv remember what is installed, so that nothing happens when nothing has changed. PyBullet is
# installed too if there is a wheel of it for this Python.
#
# Only ros2, which stands alone, has an environment of its own, .venv-ros2: the wheels of ROS 2 make every Python of
# their environment start itself anew once, to find their libraries, and that should cost nobody else anything. There
# are such wheels for Linux on x86-64; elsewhere nothing is installed, and the message says so.
#
# PYTHON names the Python to take, such as python3.13; an environment of another version is made anew.
set -euo pipefail
cd "$(dirname "$0")/.."

venv=.venv
[ "$1" != ros2 ] || venv=.venv-ros2
pip=("$venv/bin/python" -m pip --quiet --disable-pip-version-check)
# A lock names all that is needed, so nothing is left to resolve. Most of it is never imported, so modules are compiled
# as they are: that halves the time, unless Python is told to keep nothing that it compiles.
install=("${pip[@]}" install --no-deps)
[ -n "${PYTHONDONTWRITEBYTECODE:-}" ] || install+=(--no-compile)

works() { # works PYTHON MODULES: it runs, is at least 3.11 and has the modules
    "$1" -c "import sys; sys.version_info >= (3, 11) or sys.exit(1); import $2" >/dev/null 2>&1
}

# What PYTHON names is taken, and nothing else. PyBullet has wheels for Python 3.11 only, so that version comes first
# otherwise, wherever it is. A name on the PATH proves nothing: it may be a version manager's shim for a Python that is
# not installed.
find_python() {
    local python without_venv= names=(python3.11 python3 python3.13 python3.12)
    [ -z "${PYTHON:-}" ] || names=("$PYTHON")
    while read -r python; do
        if works "$python" "ensurepip, venv"; then
            echo "$python"
            return
        elif works "$python" sys; then
            without_venv=${without_venv:-$python}
        fi
    done < <(type -ap "${names[@]}" || true)
    if [ -n "$without_venv" ]; then
        echo "$without_venv cannot make virtual environments: its venv module is missing." >&2
    else
        echo "SOTER needs Python 3.11 or newer, and there is none on the PATH${PYTHON:+ as PYTHON=$PYTHON}." >&2
    fi
    echo "On Debian or Ubuntu: apt-get install python3 python3-venv" >&2
    return 1
}

version() { # version PYTHON: such as 3.11, empty where it does not run
    "$1" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null || true
}

up_to_date() { # up_to_date NAME...: all of them are installed as they stand here
    local name source
    for name in "$@"; do
        for source in "requirements/$name.txt" pyproject.toml "$0"; do
            [ "$venv/stamp-$name" -nt "$source" ] || return 1
        done
    done
}

if [ "$1" = ros2 ] && [ "$(uname -sm)" != "Linux x86_64" ]; then
    echo "There are no wheels of ROS 2 for $(uname -sm); its tests are left out."
    exit 0
fi
if ! works "$venv/bin/python" pip || { [ -n "${PYTHON:-}" ] && [ "$(version "$venv/bin/python")" != "$(version "$PYTHON")" ]; }; then
    python=$(find_python)
    echo "Creating $venv with $("$python" --version) ($python)"
    "$python" -m venv --clear "$venv"
    "${install[@]}" --upgrade --constraint=requirements/check.txt pip
fi
if up_to_date "$@"; then
    exit 0
fi
echo "Installing $* and the project into $venv; what is new may take minutes"
locks=("${@/#/--requirement=requirements/}")
"${install[@]}" "${locks[@]/%/.txt}"
# What builds the project is locked too: where all is installed, nothing is asked of an index.
"${install[@]}" --no-build-isolation --editable .
if [ "$1" = ros2 ]; then
    : # The simulated ROS 2 robots need no PyBullet.
elif "${install[@]}" --only-binary :all: -r requirements/pybullet.txt 2>.venv/pybullet-wheel.log; then
    rm -f .venv/pybullet-wheel.log
else
    echo "PyBullet has no wheel for this Python; going on without it (see .venv/pybullet-wheel.log)."
fi
if [ -x "$venv/bin/lcm-gen" ]; then
    "$venv/bin/lcm-gen" -p --ppath examples/adapter-lcm examples/adapter-lcm/soter_lcm/messages.lcm
fi
touch "${@/#/$venv/stamp-}"
