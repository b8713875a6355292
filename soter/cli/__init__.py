"""The command line: `soter run`, `soter backends`, `soter conform`."""

try:
    from soter.cli.app import app, main
except KeyboardInterrupt:
    # Ctrl-C while modules are still being read: there is nothing yet that could be stopped.
    raise SystemExit(130) from None

__all__ = ["app", "main"]
