"""The command line: `soter run`, `soter backends`, `soter conform`."""

import gc

# Loading the commands makes many objects that stay and no garbage; to collect it would take a fifth of the time of
# `--help`.
gc.disable()
try:
    from soter.cli.app import app, main
except KeyboardInterrupt:
    # Ctrl-C while modules are still being loaded: there is nothing to stop yet.
    raise SystemExit(130) from None
finally:
    gc.freeze()
    gc.enable()

__all__ = ["app", "main"]
