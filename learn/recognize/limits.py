"""What limits a recogniser: how its errors lie about changes of labels, and which slots are wrong in them."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from learn.recognize.dataset import SLOTS, Labels
from learn.recognize.evaluation import WAY_NAMES, WAYS, Predicted, extent
from learn.recognize.pictures import picture

FARTHEST = 5
"""Windows from a change, or more."""
_NEVER = "no change in the session"


def change_distances(labels: Labels) -> NDArray[np.int64]:
    """Of a session's windows (w, 5), how many windows each is from the nearest change of the label: 0 for the last
    before and the first after one; -1 for all if there is none.
    """
    changes = np.flatnonzero((labels[1:] != labels[:-1]).any(axis=1))
    if not len(changes):
        return np.full(len(labels), -1, np.int64)
    after = np.arange(len(labels))[:, None] - changes  # 0 is the last before a change, 1 the first after it
    return np.minimum(np.abs(after), np.abs(after - 1)).min(axis=1)


def by_distance(found: Predicted, way: str) -> list[dict[str, Any]]:
    """Of windows by their distance to a change: how many there are, and how many whole labels are wrong."""
    distance = np.concatenate([change_distances(session.labels) for session in found.sessions])
    wrong = (found.true != found.labels[way]).any(axis=1)
    rows: list[dict[str, Any]] = []
    for number in (*range(FARTHEST + 1), -1):
        among = distance >= number if number == FARTHEST else distance == number
        name = _NEVER if number < 0 else f"{number}{' or more' if number == FARTHEST else ''}"
        rows.append({"distance": name, "windows": int(among.sum()), "wrong": int(wrong[among].sum())})
    return rows


def by_slot(found: Predicted, way: str) -> dict[str, Any]:
    """Of each slot, how many windows are wrong in it, and in it alone; and all together by which slots are wrong."""
    wrong = found.true != found.labels[way]
    alone = wrong & (wrong.sum(axis=1, keepdims=True) == 1)
    together = Counter(
        " + ".join(slot for slot, is_wrong in zip(SLOTS, row, strict=True) if is_wrong)
        for row in wrong[wrong.any(axis=1)].tolist()
    )
    return {
        "windows": len(wrong),
        "wrong": int(wrong.any(axis=1).sum()),
        "slots": {
            slot: {"wrong": int(wrong[:, place].sum()), "alone": int(alone[:, place].sum())}
            for place, slot in enumerate(SLOTS)
        },
        "together": dict(together.most_common()),
    }


def limits(found: Predicted) -> dict[str, Any]:
    """Both, of windows alone and with context."""
    return {way: {"by_distance": by_distance(found, way), "by_slot": by_slot(found, way)} for way in WAYS}


def draw_limits(found: Predicted, dest: Path) -> None:
    """A picture of the share of wrong windows by their distance to a change, and of wrong slots.

    Raises
    ------
    MissingExtraError : Matplotlib is not installed.
    """
    with picture(dest, (15, 4.5), "cannot draw errors") as figure:
        figure.suptitle(extent(found))
        left, right = figure.subplots(1, 2, width_ratios=[5, 3])
        for place, way in enumerate(WAYS):
            rows, slots = by_distance(found, way), by_slot(found, way)["slots"]
            shares = [100 * row["wrong"] / max(row["windows"], 1) for row in rows]
            bars = left.bar(np.arange(len(rows)) + 0.4 * place, shares, 0.4, label=WAY_NAMES[way])
            left.bar_label(bars, [f"{row['wrong']}\nof {row['windows']}" for row in rows], fontsize=7)
            counts = [slot["wrong"] for slot in slots.values()]
            bars = right.bar(np.arange(len(SLOTS)) + 0.4 * place, counts, 0.4, label=WAY_NAMES[way])
            right.bar_label(bars, fontsize=8)
        names = [str(row["distance"]).replace(" in ", "\nin ") for row in by_distance(found, WAYS[0])]
        left.set_xticks(np.arange(len(names)) + 0.2, names)
        left.set(xlabel="windows from a change of the label", ylabel="whole labels wrong, % of these windows")
        right.set_xticks(np.arange(len(SLOTS)) + 0.2, list(SLOTS))
        right.set(xlabel="slot of the label", ylabel="windows that are wrong in it")
        for axes in (left, right):
            axes.margins(y=0.12)
            axes.legend()
