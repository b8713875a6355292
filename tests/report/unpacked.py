"""Reads the data of a page as a browser does, to see what is in it."""

from __future__ import annotations

import base64
import json
import math
import re
import struct
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

SPECIAL = {1: math.inf, 2: -math.inf, 3: math.nan}


class Unpacked:
    """A document and its columns."""

    def __init__(self, text: str) -> None:
        whole = zlib.decompress(base64.b64decode(text))
        (length,) = struct.unpack_from("<I", whole)
        self.document: dict[str, Any] = json.loads(whole[4 : 4 + length])
        self._data = whole[4 + length :]

    def column(self, number: int) -> NDArray[np.float64]:
        """A column's values."""
        head = self.document["columns"][number]
        if head["count"] == 0:
            return np.zeros(0)
        kind = np.dtype(f"<{head['kind']}")
        differences = np.frombuffer(self._data, kind, head["count"] - 1, head["at"]).astype(np.float64)
        values: NDArray[np.float64] = np.cumsum(np.concatenate([[float(head["first"])], differences])) * head["quantum"]
        for index, flag in enumerate(self.column(head["flags"]) if "flags" in head else ()):
            if flag:
                values[index] = SPECIAL[int(flag)]
        return values


def of_page(page: str) -> Unpacked:
    """The data of a page."""
    found = re.search(r'<script type="application/octet-stream" id="recording"[^>]*>([^<]*)</script>', page)
    assert found is not None
    return Unpacked(found[1])
