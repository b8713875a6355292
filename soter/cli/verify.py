"""`soter verify`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from soter.cli.exits import ExitCode, guard
from soter.cli.option import option
from soter.cli.overrides import RecordingArgument
from soter.errors import ConfigError

if TYPE_CHECKING:
    from soter.record.digest import Proof

EXAMPLES = """Examples:
  soter verify run.mcap
  soter verify run.mcap --key public.pem
Exit codes:
  0  the recording is, to the last bit, what was written; with --key, by the owner of that key
  1  it was damaged or changed since, or is not signed by that key
  2  it cannot be told: it was cut off, has no digest, or is no recording
"""


def verify(
    recording: RecordingArgument,
    key: Annotated[Path | None, option("KEY.pem", "The public key (Ed25519) that must have signed it.")] = None,
) -> None:
    """Say whether a recording is what was written. Without a key, that only tells what happened by accident."""
    with guard():
        from soter.record.digest import DigestState, prove
        from soter.record.signing import read_public_key

        wanted = None if key is None else read_public_key(key, "--key")
        try:
            proof = prove(recording)
        except OSError as failure:
            raise ConfigError(f"'{recording}' cannot be read: {failure.strerror or failure}") from failure
        if proof.state in {DigestState.CUT_OFF, DigestState.NONE}:
            typer.echo(f"{recording}: {proof.why}")
            raise typer.Exit(ExitCode.BAD_INPUT)
        words = proof.why if proof.state is DigestState.CHANGED else _unsigned(proof, wanted)
        if words:
            typer.echo(f"{recording}: not what was written: {words}")
            raise typer.Exit(ExitCode.VIOLATION)
        by = f", signed by {proof.key}" if proof.key else ", not signed"
        typer.echo(f"{recording}: what was written, to the last bit{by}")


def _unsigned(proof: Proof, wanted: str | None) -> str:
    """Return what is wrong with a signature; empty if it is right, or not asked for."""
    from soter.record.signing import is_signature

    if wanted is not None and not proof.signature:
        return "it is not signed"
    if proof.signature and not is_signature(proof.key, proof.signature, proof.signed):
        return "its signature is not that of its key"
    if wanted is not None and proof.key != wanted:
        return f"it is signed by another key, {proof.key}"
    return ""
