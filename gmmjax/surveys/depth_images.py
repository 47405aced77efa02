"""Depth images on disk: 16-bit PNG, and NumPy arrays, with the camera that took them."""

import io
import os
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from jaxtyping import Float64

from gmmjax.clouds import atomic_write, load_arrays, read_bytes, require_file
from gmmjax.errors import InputError, one_line, warn
from gmmjax.surveys.frame import Frame
from gmmjax.surveys.intrinsics import Intrinsics

SUFFIXES = (".png", ".npy")
# The text of a PNG file that says how many metres a number of the image is.
UNIT_TEXT = "depth_unit"
MILLIMETRE = 0.001
LARGEST_NUMBER = 2**16 - 1
# No depth camera sees so far (metres): numbers beyond are of another unit.
FARTHEST = 200.0


def read_depth_frame(
    path: str | os.PathLike[str], intrinsics: Intrinsics, *, unit: float | None = None, time: float = 0.0
) -> Frame:
    """The ordered frame of a depth image.

    A pixel that is 0, negative, NaN or infinite has no return.

    Args:
        path: a `.png` of 16-bit grey, or an `.npy` array [height, width]; depth along the optical axis.
        intrinsics: of the camera.
        unit: metres for one number of the image. None: what the file says (the text `depth_unit` of a PNG), or 1 for
            floating point numbers; of integers without it the unit is not guessed.
        time: of the frame, seconds.

    Returns:
        The frame in the camera's coordinates, x right, y down, z forward, metres.

    Raises:
        InputError: the file cannot be read, is damaged, is no depth image or has no return, its unit is not known, or
            the intrinsics are of an image of another size.

    Warns:
        InputWarning: depths that no camera sees: the numbers are of another unit.
    """
    file = require_file(path)
    readers = {".png": _read_png, ".npy": _read_npy}
    if file.suffix.lower() not in readers:
        raise InputError(f"{file}: a depth image ends with {' or '.join(SUFFIXES)}; convert it to one of these")
    _check_unit(unit)
    numbers, unit_of_file = readers[file.suffix.lower()](file)
    if numbers.shape != (intrinsics.height, intrinsics.width):
        height, width = numbers.shape
        raise InputError(
            f"{file}: is {width} x {height} pixels, the intrinsics are of {intrinsics.width} x {intrinsics.height}; "
            "give those of this image"
        )
    scale = unit or unit_of_file or (1.0 if numbers.dtype.kind == "f" else None)
    if scale is None:
        raise InputError(
            f"{file}: does not say of what unit its numbers are; give the metres of one number as unit "
            f"(--depth-unit {MILLIMETRE} for millimetres)"
        )
    # NaN and inf are no return, whatever their bits.
    with np.errstate(over="ignore", invalid="ignore"):
        depth = numbers.astype(np.float64) * scale
    depth[~(np.isfinite(depth) & (depth > 0))] = np.nan
    _check_depths(depth, scale, str(file))
    return Frame.of_image(intrinsics.rays().reshape(*depth.shape, 3) * depth[:, :, None], time)


def write_depth_image(path: str | os.PathLike[str], depth: Frame | npt.ArrayLike, *, unit: float = MILLIMETRE) -> None:
    """Write a depth image as 16-bit PNG with its unit, whole or not at all; `read_depth_frame` reads it back.

    Args:
        path: the file, ending with `.png`.
        depth: an ordered frame, or depths [height, width] in metres; 0, NaN and inf are no return.
        unit: metres for one number of the image.

    Raises:
        InputError: another ending, points in no order, a depth beyond 65535 units, or a folder that cannot be written.
    """
    if Path(path).suffix.lower() != ".png":
        raise InputError(f"{path}: a depth image is written as .png; rename it")
    _check_unit(unit)
    metres = depth.depth_image() if isinstance(depth, Frame) else np.asarray(depth, np.float64)
    if metres.ndim != 2:
        raise InputError(f"{path}: a depth image is an array [height, width], not {list(metres.shape)}")
    numbers = np.rint(np.where(np.isfinite(metres) & (metres > 0), metres, 0) / unit)
    if numbers.max(initial=0) > LARGEST_NUMBER:
        raise InputError(
            f"{path}: a depth of {numbers.max() * unit:.4g} m is beyond 65535 times the unit of {unit} m; give a "
            "larger unit"
        )
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    text = PngInfo()
    text.add_text(UNIT_TEXT, repr(unit))
    content = io.BytesIO()
    Image.fromarray(numbers.astype(np.uint16)).save(content, "PNG", pnginfo=text)
    with atomic_write(path) as file:
        file.write(content.getbuffer())


def _check_unit(unit: float | None) -> None:
    if unit is not None and not 0 < unit < np.inf:
        raise InputError(f"unit={unit} must be the metres of one number of the image; 0.001 for millimetres")


def _read_png(file: Path) -> tuple[np.ndarray, float | None]:
    """The numbers of a 16-bit grey image, and the unit that the file gives."""
    from PIL import Image

    content = read_bytes(file)
    try:
        with warnings.catch_warnings():
            # An image of more pixels than any camera has is damaged, or there to exhaust the memory.
            warnings.simplefilter("error")
            image = Image.open(io.BytesIO(content), formats=["PNG"])
            image.load()
    # Pillow raises OSError, SyntaxError, ValueError, zlib.error and others on damaged files.
    except Exception as error:
        raise InputError(f"{file}: is no PNG image, or damaged ({one_line(error)}); copy it again") from error
    # Bit depth and kind of colour are in the first chunk: Pillow reads 16-bit colours as 8-bit ones.
    bits, colors = content[24], content[25]
    if (bits, colors) != (16, 0):
        kind = {0: "grey", 2: "colours", 3: "a palette", 4: "grey and alpha", 6: "colours and alpha"}.get(colors)
        raise InputError(f"{file}: has {bits}-bit {kind}, a depth image 16-bit grey; is it the picture beside it?")
    return np.array(image, np.uint16), _unit_of_text(getattr(image, "text", {}), file)


def _unit_of_text(text: Any, file: Path) -> float | None:
    if UNIT_TEXT not in text:
        return None
    found = re.fullmatch(r"\s*(\S+?)\s*(m|metres?|meters?)?\s*", str(text[UNIT_TEXT]))
    try:
        unit = float(found[1]) if found else 0.0
    except ValueError:
        unit = 0.0
    if not 0 < unit < np.inf:
        raise InputError(
            f"{file}: its text {UNIT_TEXT} {str(text[UNIT_TEXT])[:40]!r} is no number of metres; give the unit "
            f"(--depth-unit {MILLIMETRE} for millimetres)"
        )
    return unit


def _read_npy(file: Path) -> tuple[np.ndarray, None]:
    loaded = load_arrays(file)
    if isinstance(loaded, dict):
        raise InputError(f"{file}: is an .npz archive; save the image alone with numpy.save")
    if loaded.ndim != 2 or loaded.dtype.kind not in "fiu":
        raise InputError(
            f"{file}: holds {loaded.dtype} {list(loaded.shape)}, a depth image is numbers [height, width]; points "
            "[H, W, 3] are read as a cloud"
        )
    return loaded, None


def _check_depths(depth: Float64[np.ndarray, "h w"], unit: float, source: str) -> None:
    returned = depth[np.isfinite(depth)]
    if not len(returned):
        raise InputError(f"{source}: no pixel has a return; give another image")
    if (middle := float(np.median(returned))) > FARTHEST:
        warn(
            f"{source}: half of the depths are beyond {middle:.4g} m with a unit of {unit} m; if the numbers are "
            f"millimetres, give --depth-unit {MILLIMETRE} (unit={MILLIMETRE})"
        )
