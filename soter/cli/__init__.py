"""The command line: `soter run`, `soter backends`, `soter conform`."""

from soter.cli.app import app, main

__all__ = ["app", "main"]
