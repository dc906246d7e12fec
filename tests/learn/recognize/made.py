"""Small learning exports: two boxes on a table before a camera, one of which a hand moves."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

SLOPE, HEIGHT = 0.3, -0.6
N_FRAMES = 45
SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * 0.08


def on_table(x: Floats, z: Floats) -> Floats:
    """Points (..., 3) of the table, in the Kinect's camera space."""
    return np.stack([x, SLOPE * z + HEIGHT, z], axis=-1)


def scene(moved: int, *, seed: int = 0, n_frames: int = N_FRAMES, past: bool = False) -> Floats:
    """Frames (n, 21, 3) in which box ``moved`` (1 or 2) goes from the left to the middle, or past it to the right."""
    generator = np.random.default_rng(seed)
    path = np.linspace(-0.4, 0.4 if past else -0.1, n_frames)[:, None]
    rests = np.zeros((n_frames, 1))
    places = {moved: (path, rests + 1.2), 3 - moved: (rests, rests + 1.4)}
    boxes = [
        on_table(x + SQUARE[:, 0] + generator.normal(0, 1e-3), z + SQUARE[:, 1])
        for x, z in (places[1], places[2])
    ]
    joints = np.broadcast_to(generator.normal([0.0, 0.3, 1.6], 0.01, (13, 3)), (n_frames, 13, 3)).copy()
    joints[:, [3, 4, 5]] = on_table(path - 0.1, rests + 1.2)
    return np.concatenate([joints, *boxes], axis=1)


def labels(moved: int, n_frames: int = N_FRAMES, *, past: bool = False) -> list[str]:
    """The event texts of :func:`scene`: the second half of the windows has a locative."""
    n_windows = (n_frames - 20) // 5 + 1
    verb, preposition = ("pulls", "Past") if past else ("pushes", "To")
    boxes = ("Object,Theme", "Object,None") if moved == 1 else ("Theme,Object", "None,Object")
    return [
        f"Subject,{boxes[0]},{verb},{preposition}"
        if window >= n_windows // 2
        else f"Subject,{boxes[1]},{verb},None"
        for window in range(n_windows)
    ]


def session(name: str, points: Floats, events: Sequence[str]) -> str:
    frames = "".join(
        f'<frame no="{number}">'
        + "".join(
            f'<o type="{kind}">{",".join(f"{value:.4f}" for value in part.ravel())}</o>'
            for kind, part in (("rig", frame[:13]), ("glyph", frame[13:17]), ("glyph", frame[17:]))
        )
        + "</frame>"
        for number, frame in enumerate(points)
    )
    spans = "".join(
        f'<event start="{5 * place}" end="{5 * place + 20}">{text}</event>'
        for place, text in enumerate(events)
    )
    return f'<session name="{name}"><data>{frames}</data><events>{spans}</events></session>'


def write(dest: Path, *sessions: str) -> Path:
    dest.parent.mkdir(parents=True, exist_ok=True)
    dest.write_text(f"<project>{''.join(sessions)}</project>", "utf-8")
    return dest


def exports(folder: Path, n: int = 5) -> Path:
    """``n`` pushes and as many pulls, in two files, one of them deeper down."""
    for name, past in (("pushto", False), ("deeper/pullpast", True)):
        made = [
            session(
                f"{name.rpartition('/')[2]}{number + 1}",
                scene(1 + number % 2, seed=number, past=past),
                labels(1 + number % 2, past=past),
            )
            for number in range(n)
        ]
        write(folder / f"{name}.txt", *made)
    return folder
