"""What there is to see in a sample: a room, a table, the performer, boxes, and which of it moves."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from ecat.geometry.transforms import Floats, Rigid
from ecat.sample.body import JOINTS
from ecat.sample.pixels.layers import Capsule, Layer, Quad, box_layer, limb_layer
from ecat.sample.pixels.shadows import shadow_layer
from ecat.sample.pixels.textures import MAKERS, Picture, Texture, covered, smooth_noise
from ecat.sample.pixels.view import View
from ecat.sample.scene import TABLE_OUTLINE_M
from ecat.sample.truth import GroundTruth

WALL_M, FLOOR_M, HALF_ROOM_M, HEIGHT_M = 1.9, -0.74, 4.5, 3.2
TABLE_THICK_M = 0.03
SIDES = ("Left", "Right")
_ARM = ("Shoulder", "Elbow", "Wrist", "Hand", "HandTip", "Thumb")
_TABLE_TEXELS = 1000


@dataclass(frozen=True)
class Room:
    """What never moves, and the lamp's direction (3,), ``table`` frame."""

    quads: tuple[Quad, ...]
    capsules: tuple[Capsule, ...]
    lamp: Floats


def room(truth: GroundTruth, rng: np.random.Generator, texture: Texture) -> Room:
    """Wall, floor, table and the performer's trunk and head."""
    lamp = np.array([rng.uniform(-0.6, 0.6), rng.uniform(-0.7, -0.3), 1.0])
    h = HALF_ROOM_M
    x, y, z = np.eye(3)
    wall = Quad(
        np.array([-h, WALL_M, FLOOR_M + HEIGHT_M]), 2 * h * x, -HEIGHT_M * z, covered(_wall(rng, texture))
    )
    floor = Quad(np.array([-h, WALL_M, FLOOR_M]), 2 * h * x, -2 * h * y, covered(_plain(rng, 100)))
    beside = covered(_plain(rng, 120))
    left = Quad(np.array([-h, WALL_M - 2 * h, FLOOR_M + HEIGHT_M]), 2 * h * y, -HEIGHT_M * z, beside)
    right = Quad(np.array([h, WALL_M, FLOOR_M + HEIGHT_M]), -2 * h * y, -HEIGHT_M * z, beside)
    return Room((wall, floor, left, right, *_table(rng, texture)), _trunk(truth), lamp / np.sqrt(lamp @ lamp))


def _plain(rng: np.random.Generator, brightness: float) -> Picture:
    value = brightness + 10 * smooth_noise(rng, (600, 600), (7, 7)) + rng.normal(0, 3, (600, 600))
    return np.clip(value[..., None] * rng.uniform(0.85, 1.1, 3), 0, 255).astype(np.uint8)


def _wall(rng: np.random.Generator, texture: Texture) -> Picture:
    """A plain wall with pictures on it, all of ``texture`` where that is not a table's."""
    rows, columns = 640, 1800
    if texture in ("text", "checker", "photo"):
        return MAKERS[texture](rng, (rows, columns))
    wall = np.asarray(cv2.resize(_plain(rng, 175), (columns, rows)), np.uint8)
    for left in rng.uniform(550, 1150, 3).astype(int):
        top, (height, width) = int(rng.integers(180, 380)), rng.integers(60, 180, 2)
        kind: Texture = rng.choice(["text", "photo", "checker"])
        wall[top : top + height, left : left + width] = MAKERS[kind](rng, (int(height), int(width)))
    return wall


def _table(rng: np.random.Generator, texture: Texture) -> tuple[Quad, Quad]:
    """Its top, cut out along the outline, and its front edge."""
    low, high = TABLE_OUTLINE_M.min(0), TABLE_OUTLINE_M.max(0)
    width, depth = high[0] - low[0], high[1] - low[1]
    rows, columns = round(_TABLE_TEXELS * depth / width), _TABLE_TEXELS
    picture = covered(MAKERS[texture](rng, (rows, columns)))
    # the outline is a trapezium: shares of the picture where its sides are, row by row
    t = (np.arange(rows) + 0.5) / rows
    far_left, far_right, near_right, near_left = TABLE_OUTLINE_M[:, 0]
    left, right = far_left + t * (near_left - far_left), far_right + t * (near_right - far_right)
    column = np.arange(columns)
    inside = np.clip(column + 1 - (left - low[0])[:, None] / width * columns, 0, 1)
    inside *= np.clip((right - low[0])[:, None] / width * columns - column, 0, 1)
    picture = np.rint(picture * inside[..., None]).astype(np.uint8)
    top = Quad(np.array([low[0], high[1], 0.0]), np.array([width, 0, 0]), np.array([0, -depth, 0]), picture)
    corner, across = TABLE_OUTLINE_M[3], TABLE_OUTLINE_M[2] - TABLE_OUTLINE_M[3]
    front = np.clip(rng.normal([70, 100, 130], 6, (20, 400, 3)), 0, 255).astype(np.uint8)
    return top, Quad(corner, across, np.array([0, 0, -TABLE_THICK_M]), covered(front))


def _skin(seed: int) -> tuple[float, float, float]:
    tone = np.random.default_rng([seed, 11]).uniform(0.55, 1.05)
    return 130 * tone, 160 * tone, 205 * tone


def _cotton(seed: int) -> tuple[float, float, float]:
    blue, green, red = np.random.default_rng([seed, 12]).uniform(50, 200, 3).tolist()
    return blue, green, red


def _trunk(truth: GroundTruth) -> tuple[Capsule, ...]:
    """Trunk, neck and head: the joints that stand still."""
    at = {name: truth.joints[0, k] for k, name in enumerate(JOINTS)}
    shirt, skin = _cotton(truth.seed), _skin(truth.seed)
    back = np.array([0.0, 0.09, 0.0])
    side = np.array([0.08, 0.0, 0.0])
    chin, brow = np.array([0.0, -0.02, 0.04]), np.array([0.0, 0.02, 0.02])
    head, shoulders = at["Head"], np.array([0.0, 0.04, 0.0])
    return (
        Capsule(at["SpineShoulder"] + back - side, at["SpineBase"] + back - side, 0.13, shirt),
        Capsule(at["SpineShoulder"] + back + side, at["SpineBase"] + back + side, 0.13, shirt),
        Capsule(at["ShoulderLeft"] + shoulders, at["ShoulderRight"] + shoulders, 0.075, shirt),
        Capsule(at["Neck"] + back / 2, head + back / 2, 0.055, skin),
        Capsule(head - chin, head + 2 * brow, 0.085, skin),
        Capsule(head + 3 * brow, head + 2.5 * brow + np.array([0, 0, 0.02]), 0.09, (32.0, 36.0, 42.0)),
    )


def arm(joints: Floats, seed: int, side: str) -> tuple[Capsule, ...]:
    """Upper arm, forearm and hand of ``side`` for joints (25, 3)."""
    at = {name: joints[JOINTS.index(name + side)] for name in _ARM}
    shirt, skin = _cotton(seed), _skin(seed)
    hand, wrist = at["Hand"], at["Wrist"]
    cuff = at["Elbow"] + 0.6 * (wrist - at["Elbow"])
    limbs = [
        Capsule(at["Shoulder"], at["Elbow"], 0.05, shirt),
        Capsule(at["Elbow"], cuff, 0.044, shirt),
        Capsule(cuff, wrist, 0.03, skin),
        Capsule(wrist, wrist + 0.4 * (hand - wrist), 0.03, skin),
        Capsule(hand, at["Thumb"], 0.012, skin),
    ]
    return (*limbs, *_fingers(wrist, hand, at["HandTip"], at["Thumb"], skin))


def _fingers(
    wrist: Floats, hand: Floats, tip: Floats, thumb: Floats, skin: tuple[float, float, float]
) -> Iterator[Capsule]:
    """The palm's rays and the fingers, spread across the hand."""
    along = tip - wrist
    across = (thumb - hand) - ((thumb - hand) @ along) / (along @ along) * along
    across = across / np.sqrt(across @ across)
    for k, (offset, reach) in enumerate(((-0.03, 0.82), (-0.01, 0.97), (0.01, 1.0), (0.028, 0.9))):
        knuckle = hand + 0.9 * offset * across
        yield Capsule(wrist + 0.5 * offset * across, knuckle, 0.0165, skin)
        yield Capsule(
            knuckle, hand + reach * (tip - hand) + 1.15 * offset * across, 0.0098 - 0.0008 * (k == 0), skin
        )


# ------------------------------------------------------------------------------------------- what moves


@dataclass(frozen=True, eq=False)
class Thing:
    """Something that moves: ``key`` tells where it is."""

    name: str
    key: bytes
    build: Callable[[View], Layer | None]
    shadow: bool = False


@dataclass(frozen=True, eq=False)
class Cast:
    """The boxes and the performer's arms.

    Parameters
    ----------
    faces : of each box, in box axes.
    seed : of the performer's looks.
    lamp : direction (3,) of the light.
    """

    faces: Sequence[tuple[Quad, ...]]
    seed: int
    lamp: Floats

    def things(self, boxes: Rigid, joints: Floats) -> list[Thing]:
        """Everything that moves, for poses of the boxes and joints (25, 3) in the ``table`` frame."""
        made: list[Thing] = []
        for k, (faces, turn, place) in enumerate(
            zip(self.faces, boxes.rotation, boxes.translation, strict=True)
        ):
            here = placed(faces, Rigid(turn, place))
            key = turn.tobytes() + place.tobytes()
            made.append(Thing(f"box {k}", key, lambda view, q=here: box_layer(view, q, self.lamp)))
            corners = np.concatenate([quad.corners for quad in here])
            made.append(
                Thing(
                    f"shadow {k}", key, lambda view, c=corners: shadow_layer(view, c, self.lamp), shadow=True
                )
            )
        for side in SIDES:
            parts = arm(joints, self.seed, side)
            key = np.concatenate([np.concatenate([c.a, c.b]) for c in parts]).tobytes()
            made.append(Thing(f"arm {side}", key, lambda view, p=parts: limb_layer(view, p, self.lamp)))
        return made

    @staticmethod
    def centres(boxes: Rigid, joints: Floats) -> Floats:
        """Points (things, 3) by which the motion of the things is measured, in their order."""
        hands = joints[[JOINTS.index(f"Hand{side}") for side in SIDES]]
        return np.concatenate([np.repeat(boxes.translation, 2, 0), hands])


def placed(faces: tuple[Quad, ...], pose: Rigid) -> tuple[Quad, ...]:
    """Faces in box axes -> in the ``table`` frame."""
    return tuple(
        Quad(
            pose.rotation @ f.corner + pose.translation,
            pose.rotation @ f.right,
            pose.rotation @ f.down,
            f.texture,
        )
        for f in faces
    )
