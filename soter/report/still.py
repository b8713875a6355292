"""Writes a view of a world that was rendered elsewhere as a picture."""

from __future__ import annotations

import io

import numpy as np
import numpy.typing as npt
from PIL import Image

FINER = 2
"""Factor by which views are rendered larger than the picture, since the renderer draws jagged edges."""

SIZE_PX = (1200, 900)


def still_png(pixels: npt.NDArray[np.uint8]) -> bytes:
    """Return rows of red, green and blue, `FINER` times `SIZE_PX`, as the content of a PNG file."""
    buffer = io.BytesIO()
    Image.fromarray(pixels).reduce(FINER).save(buffer, format="PNG")
    return buffer.getvalue()
