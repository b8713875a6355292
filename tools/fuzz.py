"""Give spoilt inputs to everything that reads what is not its own.

    python tools/fuzz.py --format mcap --count 100000 [--first 0] [--keep FOLDER]
    python tools/fuzz.py --format mcap --count 1000 --commands

An input may be refused, in the one way that its reader names; it may not raise anything else, take more than 10 s of
processor time or more than 1 GB. With `--commands` it goes through the command line instead, each command in a process
of its own: no traceback, no more time or memory than that. Inputs are numbered; those that fail are named, and kept in
a folder if one is given. Ctrl-C ends it with what was counted so far. The exit code is 1 if there are any.
"""

from __future__ import annotations

import argparse
import resource
import signal
import sys
import time
import traceback
from pathlib import Path
from threading import Event
from types import FrameType
from typing import Final

from tools.fuzzing import commands
from tools.fuzzing.formats import NAMES, Format, make

_SHOWN: Final = 20


class TooLong(BaseException):
    """An input took too long; no reader can catch this by mistake."""


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--format", choices=NAMES, required=True)
    parser.add_argument("--count", type=int, default=1000, help="how many inputs; 1000")
    parser.add_argument("--first", type=int, default=0, help="number of the first one; 0")
    parser.add_argument("--keep", type=Path, help="folder for those that fail")
    parser.add_argument("--commands", action="store_true", help="through the command line")
    given = parser.parse_args()
    chosen = make(given.format)
    fails = commands.runner(given.format) if given.commands else reader(chosen)
    if not given.commands:
        resource.setrlimit(resource.RLIMIT_AS, (commands.address_space() + commands.MOST_BYTES, resource.RLIM_INFINITY))
    ended = Event()
    for each in (signal.SIGINT, signal.SIGTERM):
        signal.signal(each, lambda *_: ended.set())

    began_s, longest_s, failed, count = time.monotonic(), 0.0, 0, 0
    for number in range(given.first, given.first + given.count):
        data = chosen.spoilt(number)
        before_s = time.monotonic()
        why = fails(data)
        longest_s = max(longest_s, time.monotonic() - before_s)
        count += 1
        if why:
            failed += 1
            if failed <= _SHOWN:
                print(f"input {number}: {why}", flush=True)
            if given.keep is not None:
                given.keep.mkdir(parents=True, exist_ok=True)
                (given.keep / f"{given.format}-{number}").write_bytes(data)
        if ended.is_set():
            break
    most_mb = resource.getrusage(resource.RUSAGE_CHILDREN if given.commands else resource.RUSAGE_SELF).ru_maxrss / 1e3
    print(
        f"{given.format}: {count} inputs, {failed} failed, {time.monotonic() - began_s:.0f} s, the longest "
        f"{longest_s:.2f} s, at most {most_mb:.0f} MB"
    )
    sys.exit(failed > 0)


def reader(chosen: Format) -> commands.Fails:
    """Return what reads an input in this process, and says what was wrong with that."""

    def ring(_number: int, _frame: FrameType | None) -> None:
        raise TooLong

    def fails(data: bytes) -> str:
        before = signal.signal(signal.SIGPROF, ring)
        signal.setitimer(signal.ITIMER_PROF, commands.LONGEST_S)
        try:
            chosen.read(data)
        except TooLong:
            return f"it took more than {commands.LONGEST_S} s of processor time"
        except Exception:  # noqa: BLE001 - whatever it is, it is what is looked for
            return traceback.format_exc()
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            signal.signal(signal.SIGPROF, before)
        return ""

    return fails


if __name__ == "__main__":
    main()
