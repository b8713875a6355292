"""Reads a ROS map: `map.yaml` and the picture that it names, PGM or PNG."""

from __future__ import annotations

import io
import math
import re
import struct
import warnings
import zlib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from soter.errors import ConfigError
from soter.geometry.cells import MAX_CELLS, Bits, pack
from soter.geometry.draft import MAX_COORDINATE_M, Draft, Outline
from soter.geometry.grid import GridMap
from soter.problems import config_error, cut, pydantic_problems, read_limited, shown_value

if TYPE_CHECKING:
    from PIL.ImageFile import ImageFile

MAX_IMAGE_BYTES: Final = 4 * MAX_CELLS
_LEAST_CELLS: Final = 3
_KINDS: Final = "a whole PGM or PNG"
_BITS: Final = 24
"""Where a PNG says how many bits its shades and colours have."""

_UNKNOWN: Final = 50.0 / 255.0
_HALF_A_SHADE: Final = 0.5 / 255.0

Metres = Annotated[float, Field(ge=-MAX_COORDINATE_M, le=MAX_COORDINATE_M)]
Yaw = Annotated[float, Field(ge=-math.tau, le=math.tau)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]


class MapTable(BaseModel):
    """The content of `map.yaml`.

    Attributes:
        image: the picture, relative to the file; its last row is the southernmost one if the yaw is 0.
        resolution: side of a cell in metres.
        origin: the pose of the picture's lower left corner: metres east and north, and counter-clockwise radians.
        negate: whether light is occupied and dark is free.
        occupied_thresh: from 0 to 1; darker pixels are occupied.
        free_thresh: from 0 to 1; lighter pixels are free.
        mode: whether pixels in between are unknown (`trinary`, where the grey 205 always is, whatever the thresholds),
            or occupied in part (`scale`), which SOTER keeps out of.
        unknown: SOTER's own key: whether robots keep out of unknown cells.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    image: Annotated[str, Field(min_length=1, max_length=4096)]
    resolution: Annotated[float, Field(ge=0.001, le=100.0)]
    origin: Annotated[tuple[Metres, Metres, Yaw], Field(strict=False)]
    occupied_thresh: Share
    free_thresh: Share
    negate: Annotated[int, BeforeValidator(lambda said: int(said) if isinstance(said, bool) else said)] = Field(
        default=0, ge=0, le=1
    )
    mode: Literal["trinary", "scale"] = "trinary"
    unknown: Literal["obstacle", "free"] = "obstacle"

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.free_thresh >= self.occupied_thresh:
            free, occupied = self.free_thresh, self.occupied_thresh
            raise ValueError(f"free_thresh is {free:g}, allowed: below occupied_thresh, which is {occupied:g}")
        return self


def read(data: bytes, source: str) -> Draft:
    """Return the draft of a `map.yaml`, which has no stations or starts.

    Raises:
        ConfigError: the file or its picture cannot be read, or something in them is not allowed.
    """
    try:
        table = MapTable.model_validate(_yaml(data, source))
    except ValidationError as failure:
        raise config_error(pydantic_problems(failure, MapTable), source) from failure
    occupied = _occupied(table, Path(source).parent / table.image, source)
    rows, columns = occupied.shape
    x_m, y_m, yaw_rad = table.origin
    # Pictures begin in the north.
    grid = GridMap(columns, rows, table.resolution, x_m, y_m, yaw_rad, pack(occupied[::-1]))
    draft = Draft(source, map=grid)
    draft.fences.append(Outline("edge of the map", grid.ring(0, 0, columns, rows)))
    return draft


def _yaml(data: bytes, source: str) -> dict[Any, Any]:
    # Imported here: only maps need the library.
    try:
        import yaml  # type: ignore[import-untyped]
    except ImportError as failure:
        raise ConfigError(
            f"maps need PyYAML, which cannot be imported ({failure}); install it with pip install pyyaml", source=source
        ) from failure

    class Loader(yaml.SafeLoader):  # type: ignore[misc]
        """Takes 5e-2 for a number, as ROS does, and not only 5.0e-2. Takes no aliases."""

        def compose_node(self, parent: Any, index: Any) -> Any:
            """Return the next node; it would be repeated for every alias, and theirs for every alias of those."""
            if self.check_event(yaml.AliasEvent):
                alias = self.peek_event()
                raise ConfigError(
                    f"*{cut(alias.anchor)} stands for a value from elsewhere in the file; allowed: the value itself",
                    source=source,
                    line=alias.start_mark.line + 1,
                )
            return super().compose_node(parent, index)

        def construct_object(self, node: Any, deep: bool = False) -> Any:
            """Return the value of a node, which may not fit its tag, or be of sixtieths, which ROS does not read."""
            kind = node.tag.rpartition(":")[2]
            try:
                if kind in ("int", "float") and ":" in node.value:
                    raise ValueError("it is of sixtieths")
                return super().construct_object(node, deep)
            except (ValueError, LookupError, AttributeError) as failure:
                raise ConfigError(
                    f"{shown_value(node.value)} is no {kind} that is read, allowed: plain numbers and texts",
                    source=source,
                    line=node.start_mark.line + 1,
                ) from failure

    Loader.add_implicit_resolver("tag:yaml.org,2002:float", re.compile(r"[-+]?\d+[eE][-+]?\d+$"), [*"-+0123456789"])
    try:
        found = Loader(data).get_single_data()
        keys = getattr(Loader(data).get_single_node(), "value", ()) if isinstance(found, dict) else ()
    except yaml.MarkedYAMLError as failure:
        line = None if failure.problem_mark is None else failure.problem_mark.line + 1
        raise ConfigError(f"not valid YAML: {failure.problem}", source=source, line=line) from failure
    except (yaml.YAMLError, ValueError, RecursionError, TypeError, OverflowError) as failure:
        raise ConfigError(f"not valid YAML: {failure}", source=source) from failure
    if not isinstance(found, dict):
        raise ConfigError(f"it is {shown_value(found)}, allowed: a map's keys, such as image", source=source)
    seen: set[str] = set()
    for key, _ in keys:
        # YAML has each key once; its readers take the first one, or the last.
        if key.value in seen:
            raise ConfigError("it is given twice", source=source, line=key.start_mark.line + 1, key=key.value)
        seen.add(key.value)
    return {str(key): value for key, value in found.items()}


def _occupied(table: MapTable, path: Path, source: str) -> Bits:
    """Return which cells robots keep out of, row by row as in the picture."""
    try:
        shade, opaque = _pixels(read_limited(path, "map's picture", MAX_IMAGE_BYTES), str(path))
    except ConfigError as failure:
        # The key may be wrong.
        raise ConfigError(str(failure), source=source, key="image") from failure
    # In ROS, 1 means occupied.
    chance = shade if table.negate else 1.0 - shade
    occupied, free = chance > table.occupied_thresh, (chance < table.free_thresh) & opaque
    if table.mode == "trinary":
        # Some programs write this grey for unknown, with a threshold that would make it free.
        free &= np.abs(chance - _UNKNOWN) > _HALF_A_SHADE
    unknown = ~occupied & (~opaque if table.mode == "scale" else ~free)
    kept_out = ~(free | unknown) if table.unknown == "free" else ~free
    if kept_out.all():
        raise ConfigError(
            f"none of its {kept_out.size} cells is free: {np.count_nonzero(occupied)} are occupied and "
            f"{np.count_nonzero(unknown)} unknown; see occupied_thresh, free_thresh, negate and unknown",
            source=source,
            key="image",
        )
    return kept_out


def _pixels(data: bytes, source: str) -> tuple[NDArray[np.float32], Bits | np.bool_]:
    """Return how light every pixel is, from 0 to 1, and which are opaque."""
    try:
        from PIL import Image, UnidentifiedImageError
    except ImportError as failure:
        raise ConfigError(
            f"maps need Pillow, which cannot be imported ({failure}); install it with pip install pillow", source=source
        ) from failure
    try:
        with warnings.catch_warnings():
            # The sizes that it warns of are refused below.
            warnings.simplefilter("ignore")
            with Image.open(io.BytesIO(data), formats=("PPM", "PNG")) as image:
                wide, high = image.size
                if wide * high > MAX_CELLS or min(wide, high) < _LEAST_CELLS:
                    raise ConfigError(
                        f"it has {wide} x {high} pixels; allowed: at least {_LEAST_CELLS} each way, and "
                        f"{MAX_CELLS} in all",
                        source=source,
                    )
                if _goes_on(data, image):
                    raise ConfigError(
                        f"it goes on after the {wide} x {high} pixels that its head speaks of; allowed: a PGM of one "
                        "picture, whole",
                        source=source,
                    )
                colours = len(image.palette.palette) // 3 if image.palette else 0
                image.load()
                if image.mode in ("1", "L") or image.mode.startswith("I"):
                    grey = np.asarray(image.convert("L") if image.mode == "1" else image)
                    most = 65535.0 if image.mode.startswith("I") else 255.0
                    return grey.astype(np.float32) / most, _opaque(data, image, grey)
                if image.mode == "P" and np.asarray(image).max() >= colours:
                    # The library takes black for them.
                    raise ConfigError(f"it has colours that its palette lacks, allowed: {_KINDS}", source=source)
                if image.mode not in ("LA", "P", "RGB", "RGBA"):
                    raise ConfigError(f"its pixels are {image.mode}, allowed: grey or coloured ones", source=source)
                if image.mode == "RGB" and "transparency" in image.info and data[_BITS] == 16:
                    # The library keeps the upper half of each pixel's colours, but all of the transparent one's.
                    image.info["transparency"] = tuple(each >> 8 for each in image.info["transparency"])
                pixels = np.asarray(image.convert("RGBA"))
    except Image.DecompressionBombError as failure:
        raise ConfigError(f"it is too large: {failure}", source=source) from failure
    except UnidentifiedImageError as failure:
        raise ConfigError(f"it is no picture of a kind that is read, allowed: {_KINDS}", source=source) from failure
    except (OSError, SyntaxError, ValueError, OverflowError, EOFError, struct.error, zlib.error) as failure:
        # What the library says of them is for who writes pictures.
        raise ConfigError(f"it is cut off, or spoilt in its middle, allowed: {_KINDS}", source=source) from failure
    return pixels[..., :3].mean(axis=2, dtype=np.float32) / 255.0, pixels[..., 3] == 255


def _opaque(data: bytes, image: ImageFile, grey: NDArray[Any]) -> Bits | np.bool_:
    """Return which grey pixels are opaque: all but those of the one shade that a PNG may name."""
    clear = image.info.get("transparency")
    if clear is None:
        return np.True_
    # The library counts it in bits of the file, and pixels of 2 or 4 bits as if they had 8.
    bits = data[_BITS]
    return np.asarray(grey != (clear * 85 if bits == 2 else clear * 17 if bits == 4 else clear))


def _goes_on(data: bytes, image: ImageFile) -> bool:
    """Return whether a PGM has more pixels than its head says; the library reads no further than that."""
    start, pixels = image.tile[0][2], math.prod(image.size)
    if data.startswith(b"P5"):
        rest = data[start + pixels * (1 if image.mode == "L" else 2) :]
        return bool(rest.strip())
    if data.startswith(b"P2"):
        # Text, in which every number begins after a blank; the first one is that before the start.
        text = np.frombuffer(re.sub(rb"#[^\r\n]*", b"", data[start - 1 :]), dtype=np.uint8)
        blank = text <= ord(" ")
        return int(np.count_nonzero(blank[:-1] & ~blank[1:])) > pixels
    return False
