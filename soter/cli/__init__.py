"""The command line: `soter run`, `soter backends`, `soter conform`."""

import gc

# Reading the commands makes much that stays and no garbage; looking through it, now and while the help is made, would
# be a fifth of what `--help` takes.
gc.disable()
try:
    from soter.cli.app import app, main
except KeyboardInterrupt:
    # Ctrl-C while modules are still being read: there is nothing yet that could be stopped.
    raise SystemExit(130) from None
finally:
    gc.freeze()
    gc.enable()

__all__ = ["app", "main"]
