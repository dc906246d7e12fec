"""The script of a sample: which cube goes where, in whose hand, and at which frames."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ecat.errors import UsageError
from ecat.geometry.transforms import Floats, Rigid
from ecat.sample.body import HANDS, Hand, reach_m, shoulder
from ecat.sample.motion import Path, State, any_yaw, box_gap, box_quaternion, is_instance, propose
from ecat.sample.scene import HALF_M, WORKSPACE_M, Scene

ACTIONS = ("next", "past", "around", "toward", "away")
MAX_ACTIONS = 100
"""Some twenty thousand frames, about ten minutes; all of them are held in memory at once."""
_STYLES = ("flat", "lift", "tilt", "split", "flat")
_SAMPLES: Floats = np.linspace(0.0, 1.0, 81)
_TRIES = 400


@dataclass(frozen=True, kw_only=True)
class Carry:
    """One grasp of a cube.  The frames say where each phase begins; it ends where the next one does.

    The cube goes from ``share[0]`` to ``share[1]`` of its path in ``[move, still)``.  The hand is rigidly
    with it in ``[hold, release)``, at ``grip`` from its centre when the hold begins (table axes, metres).
    """

    share: tuple[float, float]
    grip: tuple[float, float, float]
    reach: int
    grasp: int
    hold: int
    move: int
    still: int
    release: int
    retreat: int
    end: int


@dataclass(frozen=True, kw_only=True)
class Move:
    """One cube's way from rest to rest: ``kind`` is an action, or ``set``, which nobody annotates."""

    kind: str
    box: int
    hand: Hand
    path: Path
    carries: tuple[Carry, ...] = ()

    @property
    def landmark(self) -> int:
        """The cube that stands."""
        return 1 - self.box


def write_script(
    rng: np.random.Generator, scene: Scene, actions: Sequence[str]
) -> tuple[State, tuple[Move, ...], int]:
    """Where the cubes stand first, the moves with their frames, and the number of frames.

    Raises
    ------
    UsageError : an action that is not in ``ACTIONS``, none at all, or more than ``MAX_ACTIONS``.
    """
    what = "cannot make a sample session"
    if unknown := sorted(set(actions) - set(ACTIONS)):
        where = f"unknown actions: {', '.join(map(repr, unknown))}"
        raise UsageError(what, where=where, fix=f"choose from {', '.join(ACTIONS)}")
    if not 0 < len(actions) <= MAX_ACTIONS:
        raise UsageError(what, where=f"{len(actions):,} actions", fix=f"give from 1 to {MAX_ACTIONS} actions")
    start, moves = _plan(rng, scene, actions)
    frame = int(rng.integers(20, 31))
    timed: list[Move] = []
    for move, split in moves:
        carries: list[Carry] = []
        for share in ((0.0, 0.5), (0.5, 1.0)) if split else ((0.0, 1.0),):
            carries.append(_carry(rng, frame, share))
            frame = carries[-1].end + int(rng.integers(8, 17))
        timed.append(replace(move, carries=tuple(carries)))
    return start, tuple(timed), frame + int(rng.integers(10, 16))


def _carry(rng: np.random.Generator, frame: int, share: tuple[float, float]) -> Carry:
    low = [16, 5, 3, 50 if share == (0.0, 1.0) else 35, 3, 5, 16]
    high = [24, 9, 7, 81 if share == (0.0, 1.0) else 46, 7, 9, 24]
    grasp, hold, move, still, release, retreat, end = (frame + np.cumsum(rng.integers(low, high))).tolist()
    x, y, z = rng.uniform([-0.03, 0.0, 0.015], [0.03, 0.06, 0.03]).tolist()
    return Carry(
        share=share,
        grip=(x, y, HALF_M + z),
        reach=frame,
        grasp=grasp,
        hold=hold,
        move=move,
        still=still,
        release=release,
        retreat=retreat,
        end=end,
    )


# ------------------------------------------------------------------------------------------------- plan


def _plan(
    rng: np.random.Generator, scene: Scene, actions: Sequence[str]
) -> tuple[State, list[tuple[Move, bool]]]:
    """A start, and moves (with whether each is done in two goes) that can follow one another from there."""
    styles = _styles(rng, len(actions))
    first = state = None
    moves: list[tuple[Move, bool]] = []
    for kind, style in zip(actions, styles, strict=True):
        before, ready, move = _next_move(rng, scene, kind, style, state)
        first = first or ready
        moves += [(each, False) for each in before]
        moves.append((move, style == "split"))
        state = _after(ready, move)
    assert first is not None
    return first, moves


def _styles(rng: np.random.Generator, n: int) -> list[str]:
    """How each action is done; one action alone is never interrupted."""
    if n == 1:
        return [str(rng.choice(["flat", "lift", "tilt"]))]
    styles: list[str] = []
    while len(styles) < n:
        styles += rng.permutation(_STYLES).tolist()
    styles = styles[:n]
    if "split" not in styles:
        styles[int(rng.integers(n))] = "split"
    return styles


def _next_move(
    rng: np.random.Generator, scene: Scene, kind: str, style: str, state: State | None
) -> tuple[tuple[Move, ...], State, Move]:
    """Rearrangements, the state that they lead to, and the next action from there.

    Without a ``state`` the cubes stand wherever the action wants them.
    """
    for before, ready in _openings(rng, scene, state):
        move = _attempt(rng, scene, kind, ready, style)
        if move is not None:
            return before, ready, move
    raise AssertionError(f"found no way to play {kind}")


def _openings(
    rng: np.random.Generator, scene: Scene, state: State | None
) -> Iterator[tuple[tuple[Move, ...], State]]:
    """States from which the next action may start: this one, then others one rearrangement or more away."""
    if state is None:
        yield from (((), _random_state(rng, scene)) for _ in range(_TRIES))
        return
    before: tuple[Move, ...] = ()
    yield before, state
    for tried in range(1, _TRIES):
        move = _attempt(rng, scene, "set", state, "flat")
        if move is None:
            continue
        yield (*before, move), _after(state, move)
        # from some places nothing good is one move away: go on from elsewhere
        if tried % 20 == 0:
            before, state = (*before, move), _after(state, move)


def _random_state(rng: np.random.Generator, scene: Scene) -> State:
    """Two cubes apart, both in the working area and in reach."""
    yaw = np.array([any_yaw(rng), any_yaw(rng)])
    low, high = WORKSPACE_M
    while True:
        one = rng.normal([0.0, -0.04], [0.1, 0.05])
        angle, distance = rng.uniform(-np.pi, np.pi), rng.uniform(0.18, 0.45)
        two = one + distance * np.array([np.cos(angle), np.sin(angle)])
        state = State(np.stack([one, two] if rng.random() < 0.5 else [two, one]), yaw)
        boxes = _standing(state, 0), _standing(state, 1)
        in_reach = all(_nearer_hand(scene, box.translation[None]) for box in boxes)
        if in_reach and (two >= low).all() and (two <= high).all() and box_gap(*boxes) > 0.01:
            return state


def _standing(state: State, box: int) -> Rigid:
    quaternion = box_quaternion(state.yaw[box], np.zeros(()))
    return Rigid.from_quaternion(quaternion, np.array([*state.xy[box], HALF_M]))


def _after(state: State, move: Move) -> State:
    xy, yaw = state.xy.copy(), state.yaw.copy()
    xy[move.box], yaw[move.box] = move.path.curve(np.ones(1))[0], move.path.yaw[1]
    return State(xy, yaw)


def _attempt(rng: np.random.Generator, scene: Scene, kind: str, state: State, style: str) -> Move | None:
    """A possible move of either cube, or None when forty random ones were not."""
    lift = rng.uniform(0.03, 0.08) if style == "lift" else 0.0
    tilt = rng.uniform(0.15, 0.4) * rng.choice([-1, 1]) if style == "tilt" else 0.0
    for _ in range(40):
        box = int(rng.integers(2))
        curve, yaw = propose(kind, rng, state, box)
        path = Path(curve, (float(state.yaw[box]), float(yaw)), float(lift), float(tilt))
        hand = _possible(scene, kind, state, box, path)
        if hand is not None:
            return Move(kind=kind, box=box, hand=hand, path=path)
    return None


def _possible(scene: Scene, kind: str, state: State, box: int, path: Path) -> Hand | None:
    """The hand for a path that is an instance of ``kind``, stays in reach and leaves the other cube alone."""
    place, yaw, tilt, _ = path.at(_SAMPLES)
    xy = place[:, :2]
    if not is_instance(kind, xy - state.xy[1 - box]):
        return None
    if (xy < WORKSPACE_M[0]).any() or (xy > WORKSPACE_M[1]).any():
        return None
    hand = _nearer_hand(scene, place)
    gap = box_gap(Rigid.from_quaternion(box_quaternion(yaw, tilt), place), _standing(state, 1 - box))
    # boxes that touch may part and meet, but not slide along each other; in between they keep clear
    return hand if gap.min() > 0.8 * min(gap[0], gap[-1], 0.005) > 0.0005 else None


def _nearer_hand(scene: Scene, place: Floats) -> Hand | None:
    """The hand nearer to all centres ``place`` (m, 3) of a cube; None if one of them is out of its reach."""
    grips = place + np.array([0.0, 0.0, HALF_M + 0.03])
    shoulders = [shoulder(hand, scene.scale, scene.sway_m) for hand in HANDS]
    far = [float(np.sqrt(((grips - start) ** 2).sum(-1)).max()) for start in shoulders]
    best = int(np.argmin(far))
    # the grip that _carry draws is up to 0.03 m to the side
    return HANDS[best] if far[best] < reach_m(scene.scale) - 0.03 else None
