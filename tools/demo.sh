#!/usr/bin/env bash
# Ten minutes of the surveillance mission, a picture of them, and a page that plays them: `make demo`. Extra arguments
# go to `soter run`.
#
# It runs on PyBullet if there is a wheel of it or a compiler to build it with, else on the kinematic engine.
set -euo pipefail
cd "$(dirname "$0")/.."

python=.venv/bin/python
picture=out/surveillance.png
recording=out/surveillance.mcap
page=out/surveillance.html

have_pybullet() {
    "$python" -c 'import pybullet' >/dev/null 2>&1
}

can_build() { # a C++ compiler with its headers, and this Python's
    local include
    include=$("$python" -c 'import sysconfig; print(sysconfig.get_path("include"))')
    printf '#include <vector>\n#include <Python.h>\n' |
        c++ -fsyntax-only -I "$include" -x c++ - >/dev/null 2>&1
}

tools/env.sh demo
backend=pybullet
missing=
if ! have_pybullet; then
    if ! can_build; then
        missing="PyBullet has no wheel for $("$python" --version), and there is nothing to build it with."
        missing+=$'\n'"To have it: apt-get install g++ python3-dev, then make demo again."
    else
        echo "PyBullet has no wheel for $("$python" --version): building it from source, once. It takes about six minutes."
        "$python" -m pip install --quiet --disable-pip-version-check -r requirements/pybullet.txt \
            2>.venv/pybullet-build.log || true
        if ! have_pybullet; then
            missing="PyBullet could not be built; .venv/pybullet-build.log says why."
        fi
    fi
    if [ -n "$missing" ]; then
        backend=kinematic
        missing+=$'\n'"So this demo runs on SOTER's own kinematic engine instead: the same mission, simpler physics."
        printf '%s\n\n' "$missing"
    fi
fi

mkdir -p "$(dirname "$picture")"
rm -f "$picture" "$recording" "$page" out/surveillance.json
status=0
# Robot 2 has so little charge that it has to drive home within the ten minutes.
.venv/bin/soter run examples/surveillance.toml --backend "$backend" --duration 600 --set battery.initial.2=0.17 \
    --picture "$picture" --json out/surveillance.json --record "$recording" "$@" || status=$?
if [ -e "$picture" ]; then
    printf '\nThe run as a picture: %s\n' "$picture"
fi
if [ -e "$recording" ] && .venv/bin/soter report "$recording" -o "$page" >/dev/null; then
    printf 'The run as a page that plays it in a browser: %s\n' "$page"
fi
if [ -n "$missing" ]; then
    printf '\n%s\n' "$missing"
fi
exit "$status"
