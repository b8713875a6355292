"""A recording proves itself: no bit of it changes unnoticed, and what was cut off is not taken for whole."""

from __future__ import annotations

import io
import random
import struct
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat, PublicFormat
from mcap.reader import make_reader
from mcap.writer import Writer
from typer.testing import CliRunner

from soter.cli.app import app
from soter.errors import ConfigError
from soter.record import digest
from soter.record.digest import MAGIC, RECORD, DigestState
from soter.record.file import RecordingFile
from soter.record.messages import TOPICS, SwitchEvent
from soter.record.reader import BadRecording, Recording
from soter.record.signing import is_signature, read_private_key, read_public_key
from tests.record.helpers import recorded

EDGE_BYTES = 50
RECORD_BYTES = 340
SAMPLED = 1000


def made(sign: Ed25519PrivateKey | None = None) -> bytes:
    """A small recording with everything that one can have."""
    stream = io.BytesIO()
    how = () if sign is None else (sign.sign, sign.public_key().public_bytes_raw())
    file = RecordingFile(stream, *how)
    file.describe("soter", {"seed": "1"})
    file.attach("result.json", b'{"violations": {"geofence": 1}}', "application/json")
    for second in range(3):
        file.write(
            TOPICS[SwitchEvent],
            SwitchEvent(float(second), 1, "AC", "geofence", "geofence", "x" * 50),
            second,
            second,
        )
        file.flush()
    file.finish()
    return stream.getvalue()


def proof(data: bytes) -> digest.Proof:
    return digest._proof(io.BytesIO(data), len(data))


@pytest.mark.parametrize("signed", [False, True])
def test_no_bit_changes_unnoticed(signed: bool) -> None:
    whole = made(Ed25519PrivateKey.generate() if signed else None)
    assert proof(whole).state is DigestState.WHOLE
    data, bits = bytearray(whole), 8 * len(whole)
    # The head, the footer and its mark are where a change could be taken for something else.
    places = {*range(8 * EDGE_BYTES), *range(bits - 8 * EDGE_BYTES, bits)}
    record = whole.index(RECORD.encode())
    places |= {*range(8 * record, 8 * min(len(whole), record + RECORD_BYTES))}
    places |= {*random.Random(1).sample(range(bits), SAMPLED)}
    for place in places:
        data[place >> 3] ^= 1 << (place & 7)
        assert proof(bytes(data)).state is DigestState.CHANGED, f"bit {place & 7} of byte {place >> 3}"
        data[place >> 3] ^= 1 << (place & 7)


def test_what_was_cut_off_or_added_to_is_never_taken_for_whole() -> None:
    whole = made()
    states = {length: proof(whole[:length]).state for length in range(len(MAGIC), len(whole), 7)}
    assert {*states.values()} == {DigestState.CUT_OFF}
    assert proof(whole + b"\0").state is DigestState.CHANGED
    assert proof(whole + MAGIC).state is DigestState.CHANGED


def test_other_tools_read_it_and_show_the_digest() -> None:
    found = {each.name: each.metadata for each in make_reader(io.BytesIO(made())).iter_metadata()}
    assert len(found[RECORD]["sha256"]) == digest.DIGEST_DIGITS
    assert not found[RECORD]["signed by"]


def test_a_recording_without_a_digest_says_so_and_its_attachments_are_verified(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    recorded(path, duration_s=1.0)
    old = io.BytesIO()
    writer = Writer(old)
    writer.start(profile="soter", library="soter")
    whole = Recording(path)
    assert not whole.truncated
    for name, data in whole.attachments.items():
        writer.add_attachment(0, 0, name, "application/octet-stream", data)
    writer.finish()  # type: ignore[no-untyped-call]
    path.write_bytes(old.getvalue())
    opened = Recording(path)
    assert opened.proof is not None
    assert opened.proof.state is DigestState.NONE
    assert "has no digest" in opened.proof.why
    path.write_bytes(old.getvalue().replace(b'"status": "completed"', b'"status": "Completed"'))
    with pytest.raises(BadRecording, match=r"an attachment at byte .* does not fit its checksum"):
        Recording(path)


def test_every_command_refuses_what_was_changed(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    recorded(path, duration_s=1.0)
    data = bytearray(path.read_bytes())
    data[data.index(b'"status": "completed"') + 12] ^= 32
    # Whoever changes it may mend its checksum; the digest is over all of it.
    path.write_bytes(data)
    for command in ("info", "replay", "report"):
        done = CliRunner().invoke(app, [command, str(path)])
        assert done.exit_code == 2
        assert "it was damaged or changed after it was written" in done.output
    done = CliRunner().invoke(app, ["verify", str(path)])
    assert (done.exit_code, "not what was written" in done.output) == (1, True)


def test_verify_answers_in_a_sentence(tmp_path: Path) -> None:
    private, public = keys(tmp_path, "mine")
    _, another = keys(tmp_path, "another")
    path = tmp_path / "run.mcap"

    def said(data: bytes, *options: str) -> tuple[int, str]:
        path.write_bytes(data)
        done = CliRunner().invoke(app, ["verify", str(path), *options])
        assert done.output.count("\n") == 1
        return done.exit_code, done.output

    signed = made(read_private_key(private, "--sign"))
    assert said(made()) == (0, f"{path}: what was written, to the last bit, not signed\n")
    assert said(made(), "--key", str(public)) == (1, f"{path}: not what was written: it is not signed\n")
    assert said(signed, "--key", str(public))[0] == 0
    code, words = said(signed, "--key", str(another))
    assert code == 1
    assert "signed by another key" in words
    assert said(signed[:-20])[0] == 2
    assert said(b"# Notes\n")[0] == 1
    path.unlink()
    assert CliRunner().invoke(app, ["verify", str(path)]).exit_code == 2


def test_who_makes_a_digest_of_its_own_cannot_sign_it(tmp_path: Path) -> None:
    private, public = keys(tmp_path, "mine")
    found = proof(made(read_private_key(private, "--sign")))
    assert found.key == read_public_key(public, "--key")
    assert is_signature(found.key, found.signature, found.signed)
    assert not is_signature(found.key, found.signature, bytes(32))
    for path, wrong in ((private, read_public_key), (public, read_private_key)):
        with pytest.raises(ConfigError, match=r"is no (public|private) key of Ed25519"):
            wrong(path, "--key")


@pytest.mark.parametrize("size", [0, 3, 8, 9, 40])
def test_any_bytes_are_judged(size: int) -> None:
    for seed in range(50):
        noise = random.Random(seed).randbytes(size)
        assert proof(noise).state is not DigestState.WHOLE
        assert proof(MAGIC + noise).state is not DigestState.WHOLE
        assert proof(MAGIC + struct.pack("<BQ", seed % 16, size) + noise + MAGIC).state is not DigestState.WHOLE


def keys(folder: Path, name: str) -> tuple[Path, Path]:
    """A private and a public key, in files."""
    key = Ed25519PrivateKey.generate()
    private, public = folder / f"{name}.pem", folder / f"{name}.pub.pem"
    private.write_bytes(key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))
    public.write_bytes(key.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo))
    return private, public
