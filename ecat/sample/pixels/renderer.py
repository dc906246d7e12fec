"""Images of a sample: colour and depth, from what really happened."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ecat.errors import UsageError
from ecat.geometry.boxes import box_corners
from ecat.geometry.cameras import KINECT_V2_DEPTH, Camera
from ecat.geometry.transforms import Floats, Rigid
from ecat.sample.pixels.layers import (
    Layer,
    Quad,
    lambert,
    limb_layer,
    quad_layer,
    smeared,
    transmissions,
    tripled,
)
from ecat.sample.pixels.seen import SeenFaces, seen_faces
from ecat.sample.pixels.sensors import ColorNoise, DepthNoise, NoiseTape, noisy, time_of_flight
from ecat.sample.pixels.textures import Texture, box_faces
from ecat.sample.pixels.view import Pixels, Rect, View, flipped, resized
from ecat.sample.pixels.world import Cast, Room, Thing, room
from ecat.sample.truth import GroundTruth

SHUTTER = 0.25
"""Share of the time between two images during which the shutter is open, around the image's time."""
_BACKGROUNDS = 6
_STREAM = {"color": 1, "color2": 2, "depth": 3}


def second_camera(camera: Camera) -> Camera:
    """Another colour camera of the same make, half a metre to the right of the first, turned towards the table."""
    turn = math.radians(-24)
    rotation = np.array(
        [[math.cos(turn), 0, math.sin(turn)], [0, 1, 0], [-math.sin(turn), 0, math.cos(turn)]]
    )
    place = Rigid(rotation, np.array([0.62, -0.02, 0.08]))
    c = camera
    return Camera(
        "color2",
        c.width,
        c.height,
        fx=0.99 * c.fx,
        fy=0.99 * c.fy,
        cx=c.cx + 4,
        cy=c.cy - 6,
        mirrored=c.mirrored,
        reference=c.reference,
        from_reference=place.inverse(),
    )


@dataclass(frozen=True, eq=False)
class Backdrop:
    """What never moves, as one camera sees it: ``color`` (h, w, 3), ``inverse_depth`` and ``light`` (h, w)."""

    color: Pixels
    inverse_depth: Pixels
    light: Pixels


class Renderer:
    """Makes the images of a sample.

    An image depends on the arguments here, the frame and the camera, not on what was asked for before.  Lengths of time
    are frames: ``color(2.5)`` is the image half way between frames 2 and 3.

    Parameters
    ----------
    truth : what happens.
    seed : of textures, light and noise.
    size, depth_size : (width, height) of colour and of depth images; the camera's own if not given.  Where one pixel
        stands for many of the Kinect's, the noise of depth is that of their mean.
    mirrored : whether images are delivered left for right; as the truth's camera has it if not given.
    cameras : one or two colour cameras, ``color`` and ``color2``.
    blur_px : standard deviation of the optical blur of colour images.
    noise, depth_noise : of the sensors; ``EXACT_COLOR`` and ``EXACT_DEPTH`` for none.
    motion_blur : colour images of moving things are smeared over ``SHUTTER`` of the time between frames.
    texture : of table and room; one for the seed if not given.
    markers : without them the boxes are blank.

    Raises
    ------
    UsageError : impossible sizes or numbers of cameras.
    """

    def __init__(
        self,
        truth: GroundTruth,
        *,
        seed: int = 0,
        size: tuple[int, int] | None = None,
        depth_size: tuple[int, int] | None = None,
        mirrored: bool | None = None,
        cameras: int = 1,
        blur_px: float = 0.7,
        noise: ColorNoise = ColorNoise(),  # noqa: B008  (frozen)
        depth_noise: DepthNoise = DepthNoise(),  # noqa: B008
        motion_blur: bool = True,
        texture: Texture | None = None,
        markers: bool = True,
    ) -> None:
        if cameras not in (1, 2):
            raise UsageError("cannot render", where=f"{cameras} colour cameras", fix="ask for one or two")
        for width, height in (asked for asked in (size, depth_size) if asked is not None):
            if min(width, height) < 16:
                raise UsageError(
                    "cannot render", where=f"images of {width} x {height}", fix="ask for 16 x 16 or more"
                )
        self.truth = truth
        self._seed, self._blur, self._motion_blur = seed, blur_px, motion_blur
        self._noise = noise
        self._views = {
            camera.name: View(
                camera, camera.from_reference @ truth.scene.depth_from_table, camera.name == "depth"
            )
            for camera in _cameras(truth, (size, depth_size), mirrored=mirrored, cameras=cameras)
        }
        chip = self._views["depth"].camera
        share = KINECT_V2_DEPTH.width * KINECT_V2_DEPTH.height / (chip.width * chip.height)
        self._depth_noise = depth_noise.mean_of(share)
        world = np.random.default_rng([seed, 31])
        self._room: Room = room(truth, world, texture or world.choice(["wood", "cloth", "clutter"]))
        faces = [box_faces(box, markers=markers) for box in truth.prototypes]
        self._cast = Cast(faces, truth.seed, self._room.lamp)
        self._kept: dict[tuple[str, str], tuple[bytes, Layer | None]] = {}
        self._backdrops: dict[str, Backdrop] = {}
        self._pools: dict[tuple[str, int], NDArray[np.uint8]] = {}

    @property
    def cameras(self) -> dict[str, Camera]:
        """By name: ``color``, ``color2`` if there are two, ``depth``."""
        return {name: view.camera for name, view in self._views.items()}

    # ------------------------------------------------------------------------------------------- images

    def color(self, frame: float, camera: str = "color") -> NDArray[np.uint8]:
        """The colour image (height, width, 3), blue, green, red."""
        view, back = self._views[camera], self._backdrop(camera)
        rng = self._random(frame, camera)
        image = self._blurred(camera, int(rng.integers(_BACKGROUNDS))).copy()
        layers = self._layers(frame, camera)
        for rect in _grouped([layer.rect for layer in layers], 3 * math.ceil(self._blur), view.whole):
            patch = self._composed(layers, rect, back)
            image[rect.slices] = noisy(self._optics(patch), self._noise, self._tape, rng)
        return image

    def depth(self, frame: float) -> NDArray[np.uint16]:
        """The depth image (height, width), millimetres, 0 = no measurement."""
        back = self._backdrop("depth")
        inverse, bright = back.inverse_depth.copy(), back.color[..., 1] / np.float32(255)
        for layer in self._layers(frame, "depth"):
            here = inverse[layer.rect.slices]
            nearer = layer.hit & (layer.inverse_depth > here)
            here[nearer] = layer.inverse_depth[nearer]
            full = layer.color[nearer, 1] / np.maximum(layer.cover[nearer], np.float32(0.2))
            bright[layer.rect.slices][nearer] = full / np.float32(255)
        rng = self._random(frame, "depth")
        return time_of_flight(
            np.float32(1) / inverse, bright, self._depth_noise, fixed=self._fixed, tape=self._tape, rng=rng
        )

    def faces(self, frame: float, camera: str = "color") -> SeenFaces:
        """Where the markers are in an image, and how much of each is to be seen."""
        view, (boxes, joints) = self._views[camera], self.state(frame)
        layers = {
            t.name: self._once(camera, t, view) for t in self._cast.things(boxes, joints) if not t.shadow
        }
        rings = [
            Rigid(turn, place).apply(box_corners(box))
            for box, turn, place in zip(self.truth.prototypes, boxes.rotation, boxes.translation, strict=True)
        ]
        return seen_faces(view, rings, layers)

    def state(self, frame: float) -> tuple[Rigid, Floats]:
        """Poses of the boxes and joints (25, 3) at a frame or between two, ``table`` frame."""
        truth = self.truth
        first = int(np.clip(math.floor(frame), 0, truth.n_frames - 1))
        last, share = min(first + 1, truth.n_frames - 1), float(np.clip(frame - first, 0, 1))
        one, two = truth.quaternion[:, first], truth.quaternion[:, last]
        two = np.where((one * two).sum(-1, keepdims=True) < 0, -two, two)
        place = _between(truth.position[:, first], truth.position[:, last], share)
        joints = _between(truth.joints[first], truth.joints[last], share)
        return Rigid.from_quaternion(_between(one, two, share), place), joints

    # ------------------------------------------------------------------------------------------- pieces

    def _layers(self, frame: float, camera: str) -> list[Layer]:
        """Boxes, arms and, in colour, shadows: what moves, as it is seen."""
        view = self._views[camera]
        reach = SHUTTER / 2 if self._motion_blur else 0.0
        first, last = (
            view.pixels(self._cast.centres(*self.state(frame + shift))) for shift in (-reach, reach)
        )
        made: list[Layer] = []
        for thing, way_px in zip(self._cast.things(*self.state(frame)), last - first, strict=True):
            layer = None if view.headlight and thing.shadow else self._once(camera, thing, view)
            if layer is not None:
                made.append(layer if view.headlight else smeared(layer, way_px, view.whole))
        return made

    def _once(self, camera: str, thing: Thing, view: View) -> Layer | None:
        """The layer of a thing, made anew only if it has moved."""
        key, layer = self._kept.get((camera, thing.name), (b"", None))
        if key != thing.key:
            layer = thing.build(view)
            self._kept[camera, thing.name] = thing.key, layer
        return layer

    def _random(self, frame: float, camera: str) -> np.random.Generator:
        """For one image."""
        return np.random.default_rng([self._seed, round(frame * 1e6) + 2**40, _STREAM[camera]])

    @cached_property
    def _tape(self) -> NoiseTape:
        pixels = max(view.camera.width * view.camera.height for view in self._views.values())
        return NoiseTape(self._seed, 4 * pixels)

    @cached_property
    def _fixed(self) -> Pixels:
        c = self._views["depth"].camera
        return np.random.default_rng([self._seed, 41]).standard_normal((c.height, c.width), dtype=np.float32)

    def _optics(self, image: Pixels) -> Pixels:
        if self._blur <= 0:
            return image
        size = 2 * math.ceil(3 * self._blur) + 1
        return np.asarray(cv2.GaussianBlur(image, (size, size), self._blur), np.float32)

    def _composed(self, layers: Sequence[Layer], rect: Rect, back: Backdrop) -> Pixels:
        """Light (h, w, 3) in a rectangle: the layers before the backdrop, in uneven light."""
        layers = [layer for layer in layers if layer.rect.common(rect)]
        light, patch = back.light[rect.slices], back.color[rect.slices].copy()
        for layer in layers:
            patch[layer.rect.within(rect)] *= tripled(1 - layer.cover * _before(layer, back))
        for layer, passed in zip(layers, transmissions(layers, back.inverse_depth), strict=True):
            part = layer.rect.within(rect)
            patch[part] += layer.color * tripled(passed * light[part])
        return patch

    def _blurred(self, camera: str, number: int) -> NDArray[np.uint8]:
        """One of several images of the backdrop alone, as the camera gives them."""
        if (camera, number) not in self._pools:
            sharp = self._backdrop(camera).color
            rng = np.random.default_rng([self._seed, 51, number, _STREAM[camera]])
            self._pools[camera, number] = noisy(self._optics(sharp), self._noise, self._tape, rng)
        return self._pools[camera, number]

    def _backdrop(self, camera: str) -> Backdrop:
        if camera not in self._backdrops:
            self._backdrops[camera] = _backdrop(self._views[camera], self._room, self._seed)
        return self._backdrops[camera]


def _cameras(
    truth: GroundTruth,
    sizes: tuple[tuple[int, int] | None, tuple[int, int] | None],
    *,
    mirrored: bool | None,
    cameras: int,
) -> list[Camera]:
    color, depth = truth.scene.color, KINECT_V2_DEPTH
    if sizes[0] is not None:
        color = resized(color, *sizes[0])
    if sizes[1] is not None:
        depth = resized(depth, *sizes[1])
    made = [*[color, second_camera(color)][:cameras], depth]
    return [camera if mirrored in {None, camera.mirrored} else flipped(camera) for camera in made]


def _between(first: Floats, last: Floats, share: float) -> Floats:
    """The way from one to the other; what stands still stays the same to the last digit, so that it is drawn once."""
    return np.where(first == last, first, (1 - share) * first + share * last)


def _before(layer: Layer, back: Backdrop) -> Any:
    """Where (h, w) the layer is before the backdrop."""
    return 1.0 if layer.standing else layer.inverse_depth >= back.inverse_depth[layer.rect.slices]


def _grouped(rects: Sequence[Rect], margin: int, whole: Rect) -> list[Rect]:
    """The rectangles with a margin, those that overlap put together."""
    waiting = [Rect(r.left - margin, r.top - margin, r.right + margin, r.bottom + margin) for r in rects]
    groups: list[Rect] = []
    while waiting:
        rect = waiting.pop()
        near = next((group for group in groups if group.common(rect)), None)
        if near is None:
            groups.append(rect)
        else:
            groups.remove(near)
            waiting.append(rect.around(near))
    return [rect for group in groups if (rect := group.common(whole))]


def _backdrop(view: View, room: Room, seed: int) -> Backdrop:
    """The room without what moves, in uneven light."""
    flat = [quad_layer(view, quad, _shade(view, quad, room.lamp)) for quad in room.quads]
    layers = [layer for layer in (*flat, limb_layer(view, room.capsules, room.lamp)) if layer is not None]
    shape = view.whole.shape
    color, inverse = np.zeros((*shape, 3), np.float32), np.full(shape, 1e-3, np.float32)
    for layer, passed in zip(layers, transmissions(layers), strict=True):
        here = layer.rect.slices
        color[here] += layer.color * passed[..., None]
        inverse[here] = np.maximum(inverse[here], np.where(layer.hit, layer.inverse_depth, 0))
    light = np.ones(shape, np.float32) if view.headlight else _uneven_light(shape, seed)
    return Backdrop(color * light[..., None], inverse, light)


def _shade(view: View, quad: Quad, lamp: Floats) -> float:
    return 1.0 if view.headlight else lambert(quad.normal, lamp)


def _uneven_light(shape: tuple[int, int], seed: int) -> Pixels:
    """Brightness (h, w): a gradient, a vignette and the soft edge of the light from a window."""
    rng = np.random.default_rng([seed, 61])
    y, x = np.mgrid[-1 : 1 : shape[0] * 1j, -1 : 1 : shape[1] * 1j].astype(np.float32)
    slope, turn = rng.uniform(0.03, 0.12), rng.uniform(0, 2 * math.pi)
    across = np.float32(math.cos(turn)) * x + np.float32(math.sin(turn)) * y
    edge = 1 / (
        1 + np.exp((x + np.float32(rng.uniform(-0.4, 0.4)) * y - np.float32(rng.uniform(-0.5, 0.5))) / 0.04)
    )
    vignette = 1 - 0.13 * (x * x + 0.32 * y * y)
    made = (1 + np.float32(slope) * across) * vignette * (1 - np.float32(rng.uniform(0, 0.14)) * edge)
    return made.astype(np.float32)
