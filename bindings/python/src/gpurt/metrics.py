"""Errors of a picture against a reference, and reading the reference.

The error of a pixel is the mean over its channels of (x - r)^2 / (r^2 + 0.01): relative where there is light, finite
where there is none. `relmse` is its mean; `trimmed` is the mean without the worst 0.1 % of the pixels, which a few
fireflies cannot move. Both fall as 1 / time for an unbiased method, so time x trimmed is a figure of efficiency.
"""

from __future__ import annotations

import os
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from gpurt.errors import FileError, InvalidArgument

Picture = npt.NDArray[Any]

#: Keeps the error of black pixels finite.
DARK = 0.01


class Errors(NamedTuple):
    relmse: float
    trimmed: float
    bias: float  #: mean of (x - r) as a share of the reference's mean; nan for a black reference


def check_pictures(test: Picture, reference: Picture) -> None:
    """Raises InvalidArgument for different sizes and for values that are not finite."""
    if test.shape != reference.shape:
        raise InvalidArgument(f"test: is {test.shape[1]}x{test.shape[0]}, the reference is "
                              f"{reference.shape[1]}x{reference.shape[0]}")
    for name, picture in (("test", test), ("reference", reference)):
        wrong = ~np.isfinite(picture)
        if wrong.any():
            y, x = np.argwhere(wrong.any(-1))[0]
            raise InvalidArgument(f"{name}: {int(wrong.any(-1).sum())} pixels are not finite, the first at "
                                  f"x={x} y={y}")


def pixel_errors(test: Picture, reference: Picture) -> npt.NDArray[np.float64]:
    """The error of each pixel, [h][w]."""
    check_pictures(test, reference)
    x, r = test.astype(np.float64), reference.astype(np.float64)
    errors: npt.NDArray[np.float64] = ((x - r) ** 2 / (r ** 2 + DARK)).mean(-1)
    return errors


def relmse(test: Picture, reference: Picture, noise: float = 0.0) -> float:
    """Mean error. `noise` is the reference's own, which is subtracted: the errors of independent pictures add."""
    return float(pixel_errors(test, reference).mean()) - noise


def trimmed_mean(errors: npt.NDArray[np.float64], trim: float = 0.001) -> float:
    """The mean without the worst share `trim`, rounded up to whole pixels; one pixel at least remains."""
    if not 0 <= trim < 1:
        raise InvalidArgument(f"trim: {trim} is outside [0, 1)")
    kept = max(errors.size - int(np.ceil(errors.size * trim)), 1)
    return float(np.sort(errors, axis=None)[:kept].mean())


def trimmed(test: Picture, reference: Picture, trim: float = 0.001, noise: float = 0.0) -> float:
    """Mean error without the worst share of the pixels. `noise` is the reference's own, trimmed alike."""
    return trimmed_mean(pixel_errors(test, reference), trim) - noise


def bias(test: Picture, reference: Picture) -> float:
    """Mean of (x - r) as a share of the reference's mean."""
    check_pictures(test, reference)
    mean = float(reference.mean(dtype=np.float64))
    difference = float((test.astype(np.float64) - reference).mean())
    return difference / mean if mean else float("nan")


def compare(test: Picture, reference: Picture, noise: float = 0.0, noise_trimmed: float = 0.0) -> Errors:
    """All measures at once."""
    errors = pixel_errors(test, reference)
    return Errors(float(errors.mean()) - noise, trimmed_mean(errors) - noise_trimmed, bias(test, reference))


def tonemap(picture: Picture) -> npt.NDArray[np.uint8]:
    """As the library's PNG files: x / (1 + x), then the sRGB curve, rounded to 8 bits."""
    x = np.maximum(picture.astype(np.float64), 0)
    x = x / (1 + x)
    x = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
    pixels: npt.NDArray[np.uint8] = (x * 255 + 0.5).astype(np.uint8)
    return pixels


def read_exr(path: "str | os.PathLike[str]") -> npt.NDArray[np.float32]:
    """R, G and B of an EXR file as float32 [h][w][3]; a lone Y is repeated.

    Needs the package OpenEXR: pip install 'gpurt[chart]'. Raises FileError.
    """
    try:
        import OpenEXR
    except ImportError:
        raise ImportError("reading EXR files needs the package OpenEXR: pip install 'gpurt[chart]'") from None
    name = os.fspath(path)
    if not os.path.isfile(name):
        raise FileError(f"{name}: no such file")
    try:
        channels = OpenEXR.File(name).channels()
    except Exception as error:  # the package raises whatever its C++ side does
        raise FileError(f"{name}: not a readable EXR file ({error})") from None
    for group in ("RGB", "RGBA"):
        if group in channels:
            return np.asarray(channels[group].pixels[..., :3], np.float32)
    if all(c in channels for c in "RGB"):
        return np.stack([np.asarray(channels[c].pixels, np.float32) for c in "RGB"], -1)
    if "Y" in channels:
        return np.repeat(np.asarray(channels["Y"].pixels, np.float32)[..., None], 3, -1)
    raise FileError(f"{name}: no channels R, G, B (found {', '.join(sorted(channels)) or 'none'})")
