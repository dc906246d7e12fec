"""What two cubes do: poses along a path, the gap between them, and paths that are instances of an action.

The conditions that make a path a ``next``, ``past``, ``around``, ``toward`` or ``away`` follow the automatic
evaluators of thesis §5.8.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import TypeAlias

import numpy as np

from ecat.geometry.transforms import Floats, Rigid
from ecat.sample.scene import EDGE_M, HALF_M, YAW_RAD

Curve: TypeAlias = Callable[[Floats], Floats]
"""Positions (m, 2) on the table for path parameters (m,) from 0 to 1."""


@dataclass(frozen=True)
class State:
    """Both cubes at rest: ``xy`` (2, 2) metres and ``yaw`` (2,) radians in the table frame."""

    xy: Floats
    yaw: Floats


@dataclass(frozen=True)
class Path:
    """How one cube goes from rest to rest: ``lift_m`` and ``tilt_rad`` are the greatest on the way."""

    curve: Curve
    yaw: tuple[float, float]
    lift_m: float = 0.0
    tilt_rad: float = 0.0

    def at(self, s: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Centre (m, 3), yaw, tilt, lift (m,) at path parameters ``s`` (m,)."""
        bump = 64 * (s * (1 - s)) ** 3
        tilt, lift = self.tilt_rad * bump, self.lift_m * bump
        # a tilted cube stands on its lowest edge
        z = lift + HALF_M * (np.abs(np.sin(tilt)) + np.cos(tilt))
        return np.column_stack([self.curve(s), z]), self.yaw[0] + (self.yaw[1] - self.yaw[0]) * s, tilt, lift


def minimum_jerk(tau: Floats) -> Floats:
    """The share of a way covered after the share ``tau`` of its time (Flash and Hogan, J. Neurosci. 1985)."""
    return tau**3 * (10 - 15 * tau + 6 * tau**2)


def box_quaternion(yaw: Floats, tilt: Floats) -> Floats:
    """Quaternions (..., 4) of a cube turned by ``yaw`` about z after a ``tilt`` about its own y axis."""
    sz, cz, sy, cy = np.sin(yaw / 2), np.cos(yaw / 2), np.sin(tilt / 2), np.cos(tilt / 2)
    return np.stack([-sz * sy, cz * sy, sz * cy, cz * cy], -1)


_GRID = np.linspace(-HALF_M, HALF_M, 5)
_EDGE_POINTS: Floats = np.array(
    [p for p in product(_GRID, repeat=3) if sum(abs(value) == HALF_M for value in p) >= 2], dtype=np.float64
)


def box_gap(a: Rigid, b: Rigid) -> Floats:
    """Free distance (...) between two cubes, metres; 0 where they overlap.

    Exact while both stand on the table; with a tilted one, edges are compared at five points each.
    """
    gaps: list[Floats] = []
    for one, other in ((a, b), (b, a)):
        points = one.rotation[..., None, :, :] @ _EDGE_POINTS[:, :, None]
        points = points[..., 0] + (one.translation - other.translation)[..., None, :]
        inside = np.abs(points @ other.rotation) - HALF_M
        beyond = np.maximum(inside, 0)
        gaps.append(np.sqrt((beyond * beyond).sum(-1)).min(-1))
    return np.minimum(*gaps)


# -------------------------------------------------------------------------------------------- proposals


def _unit(angle: float) -> Floats:
    return np.array([math.cos(angle), math.sin(angle)])


def bezier(start: Floats, control: Floats, end: Floats) -> Curve:
    """A quadratic Bezier curve on the table."""

    def curve(s: Floats) -> Floats:
        t = s[:, None]
        return (1 - t) ** 2 * start + 2 * t * (1 - t) * control + t**2 * end

    return curve


def _arc(centre: Floats, angle: float, sweep: float, radii: tuple[float, float, float]) -> Curve:
    """Round ``centre`` from ``angle`` by ``sweep``, at the given distances at beginning, middle and end."""
    first, middle, last = radii

    def curve(s: Floats) -> Floats:
        bulge = (middle - (first + last) / 2) * 16 * (s * (1 - s)) ** 2
        radius, turned = first + (last - first) * s + bulge, angle + sweep * s
        return centre + radius[:, None] * np.stack([np.cos(turned), np.sin(turned)], -1)

    return curve


def any_yaw(rng: np.random.Generator) -> float:
    """A yaw at which the camera sees at least one marked side."""
    return YAW_RAD + rng.uniform(-0.7, 0.7)


def propose(kind: str, rng: np.random.Generator, state: State, box: int) -> tuple[Curve, float]:
    """A random path of the cube ``box`` that may be an instance of ``kind``, and the yaw at its end."""
    start, centre = state.xy[box], state.xy[1 - box]
    away = start - centre
    distance, bearing = math.hypot(*away), math.atan2(away[1], away[0])
    yaw = any_yaw(rng)
    if kind == "next":
        facing = state.yaw[1 - box] + math.pi / 2 * rng.integers(4)
        gap, aside = EDGE_M + rng.uniform(0.0015, 0.004), rng.uniform(-0.02, 0.02)
        end = centre + gap * _unit(facing) + aside * _unit(facing + math.pi / 2)
        turns = round((YAW_RAD - facing) / (math.pi / 2))
        yaw = facing + turns * math.pi / 2 + rng.uniform(-0.008, 0.008)
        return bezier(start, end + rng.uniform(0.06, 0.15) * _unit(facing), end), yaw
    if kind in ("past", "around"):
        sweep = math.pi * (rng.uniform(0.78, 1.05) if kind == "past" else rng.uniform(1.12, 1.6))
        radii = (distance, rng.uniform(0.215, 0.26), rng.uniform(0.24, 0.34))
        return _arc(centre, bearing, sweep * rng.choice([-1, 1]), radii), yaw
    if kind == "toward":
        near = rng.uniform(0.175, max(0.18, min(0.24, distance - 0.075)))
        end = centre + near * _unit(bearing + rng.uniform(-0.2, 0.2))
        return bezier(start, (start + end) / 2, end), yaw
    if kind == "away":
        end = centre + distance * rng.uniform(1.55, 2.5) * _unit(bearing + rng.uniform(-0.2, 0.2))
        return bezier(start, (start + end) / 2, end), yaw
    end = rng.normal([0.0, -0.04], [0.13, 0.06])  # "set": rather to the middle, where everything is possible
    return bezier(start, (start + end) / 2 + rng.uniform(-0.15, 0.15, 2), end), yaw


def is_instance(kind: str, offsets: Floats) -> bool:
    """Whether a mover's positions relative to the standing cube (m, 2) are an instance of ``kind``."""
    distance = np.sqrt((offsets**2).sum(-1))
    step = offsets[-1] - offsets[0]
    if kind == "next":
        return bool(distance[-1] < 1.2 * EDGE_M and distance[0] > distance[-1] + 0.06)
    if kind == "toward":
        return bool((np.diff(distance) <= 0).all() and distance[0] > distance[-1] + 0.07)
    if kind == "away":
        return bool((np.diff(distance) >= 0).all() and distance[-1] >= 1.5 * distance[0])
    turned = np.unwrap(np.arctan2(offsets[:, 1], offsets[:, 0]))
    if kind == "around":
        return bool(abs(turned[-1] - turned[0]) >= 1.1 * math.pi)
    if kind == "past":
        ends = distance[[0, -1]]
        return bool(
            abs(turned[-1] - turned[0]) < 1.1 * math.pi
            and distance.max() <= ends.max() + 1e-9
            and (ends <= math.hypot(*step)).all()
            and min(-offsets[0] @ step / ends[0], offsets[-1] @ step / ends[1]) > 0.31 * math.hypot(*step)
        )
    return math.hypot(*step) > 0.08
