"""Finished pictures."""

from __future__ import annotations

import os
import tempfile
from typing import TYPE_CHECKING, Any, Dict, NoReturn, Optional

from gpurt._arrays import Array, FloatArray, PathLike, UIntArray
from gpurt.device import refuse_pickling

if TYPE_CHECKING:
    from gpurt.frame import Frame


class Image:
    """A frame's outputs as numpy arrays, copied when the image was made.

    image.color is the picture, float32 [h][w][3], linear Rec. 709; numpy functions take the image for it. The other
    outputs are there if the frame was made with them: image["depth"] or image.depth. In a notebook it shows itself.
    """

    def __init__(self, frame: "Frame") -> None:
        #: Where the image comes from: render on with frame.submit() and take frame.image() again.
        self.frame = frame
        #: All outputs by name.
        self.outputs: Dict[str, Array] = {}
        for name in frame.outputs:
            self.outputs[name] = frame.read(name)
        #: What the picture took, and the settings used.
        self.statistics = frame.statistics

    def __getitem__(self, output: str) -> Array:
        try:
            return self.outputs[output]
        except KeyError:
            raise KeyError(f"no output {output!r}, only {', '.join(self.outputs)}; "
                           f"render with outputs=({output!r},)") from None

    @property
    def color(self) -> FloatArray:
        """float32 [h][w][3]: radiance, the mean over the samples."""
        return self["color"]

    @property
    def alpha(self) -> FloatArray:
        """float32 [h][w]: share of samples whose eye ray hit something."""
        return self["alpha"]

    @property
    def sample_count(self) -> UIntArray:
        """uint32 [h][w]."""
        return self["sample_count"]

    @property
    def depth(self) -> FloatArray:
        """float32 [h][w]: distance from the camera's plane, first sample; inf: nothing hit."""
        return self["depth"]

    @property
    def normal(self) -> FloatArray:
        """float32 [h][w][3]: shading normal towards the viewer, mean over the samples."""
        return self["normal"]

    @property
    def albedo(self) -> FloatArray:
        """float32 [h][w][3]: reflectance of the first surface, mean over the samples."""
        return self["albedo"]

    @property
    def position(self) -> FloatArray:
        """float32 [h][w][3]: world position, first sample; nothing hit: 0."""
        return self["position"]

    @property
    def primitive(self) -> UIntArray:
        """uint32 [h][w]: first sample; INVALID_ID: nothing hit."""
        return self["primitive"]

    @property
    def instance(self) -> UIntArray:
        """uint32 [h][w]: first sample; INVALID_ID: nothing hit."""
        return self["instance"]

    @property
    def variance(self) -> FloatArray:
        """float32 [h][w][3]: variance of the colour, from two independent halves."""
        return self["variance"]

    @property
    def bias(self) -> FloatArray:
        """float32 [h][w][3], what the blur of photon mapping adds to the colour, estimated."""
        return self["bias"]

    @property
    def error(self) -> FloatArray:
        """float32 [h][w][3], what blur and noise of photon mapping move the colour by at most, with 95 % confidence."""
        return self["error"]

    @property
    def width(self) -> int:
        return self.frame.width

    @property
    def height(self) -> int:
        return self.frame.height

    def save(self, path: PathLike) -> None:
        """Writes the frame, as it is now, to a file: .exr, .png or .gpurt. See Frame.save."""
        self.frame.save(path)

    def __array__(self, dtype: Any = None, copy: Optional[bool] = None) -> Array:
        if copy is False and dtype is not None and dtype != self.color.dtype:
            raise ValueError(f"the colour is float32: as {dtype} it needs a copy")
        return self.color.astype(self.color.dtype if dtype is None else dtype, copy=bool(copy))

    def _repr_png_(self) -> bytes:
        with tempfile.TemporaryDirectory(prefix="gpurt-") as folder:
            path = os.path.join(folder, "image.png")
            self.save(path)
            with open(path, "rb") as file:
                return file.read()

    def __repr__(self) -> str:
        return (f"<gpurt.Image {self.width}x{self.height}, {self.statistics.samples_per_pixel} samples per pixel, "
                f"{', '.join(self.outputs)}>")

    def __reduce__(self) -> NoReturn:
        refuse_pickling("gpurt.Image", "send its arrays, such as image.color")
