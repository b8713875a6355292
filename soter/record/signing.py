"""Signatures of recordings, by Ed25519. The library is imported only when a signature is needed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from soter.errors import BackendUnavailable, ConfigError, option_error
from soter.hints import install_command

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey


def read_private_key(path: Path, option: str) -> Ed25519PrivateKey:
    """Read a private key in PEM, without a passphrase, as `openssl genpkey -algorithm ed25519` makes one.

    Raises:
        ConfigError: the file is no such key; names the option.
        BackendUnavailable: the library is not installed.
    """
    _require()
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    key = _loaded(path, option, lambda pem: load_pem_private_key(pem, None))
    if not isinstance(key, Ed25519PrivateKey):
        raise _refusal(path, option, "private", "genpkey -algorithm ed25519")
    return key


def read_public_key(path: Path, option: str) -> str:
    """Read a public key in PEM; return it as hexadecimal digits, as recordings have it.

    Raises:
        ConfigError: the file is no such key; names the option.
        BackendUnavailable: the library is not installed.
    """
    _require()
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
    from cryptography.hazmat.primitives.serialization import load_pem_public_key

    key = _loaded(path, option, load_pem_public_key)
    if not isinstance(key, Ed25519PublicKey):
        raise _refusal(path, option, "public", "pkey -pubout")
    return key.public_bytes_raw().hex()


def is_signature(key: str, signature: bytes, signed: bytes) -> bool:
    """Return whether a signature was made by a public key, given as recordings have it.

    Raises:
        BackendUnavailable: the library is not installed.
    """
    _require()
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

    try:
        Ed25519PublicKey.from_public_bytes(bytes.fromhex(key)).verify(signature, signed)
    except (InvalidSignature, ValueError):
        return False
    return True


def _loaded(path: Path, option: str, load: Callable[[bytes], object]) -> object:
    """Return the key in a file, or None if the library does not recognise it."""
    from cryptography.exceptions import UnsupportedAlgorithm

    try:
        return load(path.read_bytes())
    except OSError as failure:
        why = failure.strerror or failure
        raise option_error(option, f"'{path}' cannot be read: {why}") from failure
    except (ValueError, TypeError, UnsupportedAlgorithm):
        return None


def _refusal(path: Path, option: str, kind: str, command: str) -> ConfigError:
    return option_error(
        option, f"'{path}' is no {kind} key of Ed25519 in PEM without a passphrase; `openssl {command}` makes one"
    )


def _require() -> None:
    try:
        import cryptography  # noqa: F401 - whether it is there
    except ImportError as failure:
        raise BackendUnavailable(
            f"recordings are signed with cryptography, which cannot be imported ({failure}); install it with: "
            f"{install_command('sign')}"
        ) from failure
