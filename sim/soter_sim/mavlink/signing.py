"""The key that signs packets."""

from __future__ import annotations

import hashlib
from pathlib import Path

from soter.errors import ConfigError


def read_key(path: Path) -> bytes:
    """Return the key of a passphrase: its SHA-256, as in ground stations.

    Args:
        path: a file with the passphrase in its first line.

    Raises:
        ConfigError: the file cannot be read, or has no passphrase.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as failure:
        raise ConfigError(f"the passphrase cannot be read: {failure}", source=str(path)) from failure
    passphrase = lines[0].strip() if lines else ""
    if not passphrase:
        raise ConfigError("it is empty, allowed: a passphrase in the first line", source=str(path))
    return hashlib.sha256(passphrase.encode()).digest()
