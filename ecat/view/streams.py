"""Which streams have images to show, where each hangs, and through which camera it is seen."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ecat.geometry.records import camera_of
from ecat.geometry.transforms import Floats, Rigid
from ecat.model import Camera, Manifest, Stream
from ecat.view.scene import CAMERA, IMAGE, entity_part

DEPTH = f"{CAMERA}/depth"
IMAGES = f"{CAMERA}/images"
DEPTH_WIDTH = 320
"""Depth images wider than this are thinned to every second, third, ... pixel and row."""


@dataclass(frozen=True)
class ShownStream:
    """A stream of images.

    Parameters
    ----------
    path : the entity of its camera, or where that is unknown, of itself.
    camera : None where the calibration is unknown, or is one for images of another size.
    """

    stream: Stream
    path: str
    camera: Camera | None

    @property
    def image_path(self) -> str:
        """The entity of its images: a depth image is its camera's own, so that it is shown as points in space."""
        return self.path if self.stream.kind == "depth" else f"{self.path}/image"


def shown_streams(manifest: Manifest) -> list[ShownStream]:
    """The streams of colour, depth and infrared images whose files are there, in the manifest's order.

    The annotated video is at ``IMAGE``, the first depth stream at ``DEPTH``, all others lie below ``IMAGES``.
    """
    color = next((s for s in manifest.streams if s.kind == "color"), None)
    depth = next((s for s in manifest.streams if s.kind == "depth" and s.present), None)
    found: list[ShownStream] = []
    for stream in manifest.streams:
        if stream.present and stream.kind in ("color", "depth", "infrared"):
            own = f"{IMAGES}/{entity_part(stream.name)}"
            path = IMAGE if stream == color else DEPTH if stream == depth else own
            found.append(ShownStream(stream, path, _camera(manifest, stream)))
    return found


def _camera(manifest: Manifest, stream: Stream) -> Camera | None:
    camera = manifest.camera(stream.camera)
    if camera is None or (stream.width_px or camera.width_px, stream.height_px or camera.height_px) != (
        camera.width_px,
        camera.height_px,
    ):
        return None
    return camera


def depth_step(width_px: int) -> int:
    """Every how many pixels and rows a depth image of this width is shown."""
    return -(-width_px // DEPTH_WIDTH)


def reduced(camera: Camera, step: int) -> Camera:
    """The camera without a bent lens whose image is every ``step``-th pixel of every ``step``-th row."""
    return replace(
        camera,
        width_px=-(-camera.width_px // step),
        height_px=-(-camera.height_px // step),
        fx_px=camera.fx_px / step,
        fy_px=camera.fy_px / step,
        cx_px=camera.cx_px / step,
        cy_px=camera.cy_px / step,
        distortion=(),
    )


def straightened(camera: Camera, step: int) -> tuple[Floats, Floats]:
    """Column and row (height, width) in the camera's image of every pixel of its :func:`reduced` one.

    Rerun's cameras have no lens, so the images whose points are to lie where they were measured lose theirs.
    """
    small = reduced(camera, step)
    u, v = np.meshgrid(np.arange(small.width_px), np.arange(small.height_px))
    rays = camera_of(small).unproject(np.stack([u, v], -1).astype(float))
    source = replace(camera_of(camera), from_reference=Rigid.identity()).project(rays)
    return source[..., 0], source[..., 1]
