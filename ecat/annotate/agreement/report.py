"""The figures of an agreement, as data for programs and as a page of text for people."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np

from ecat.annotate.agreement.compare import LEAST_IOUS, PAIRING_IOU, Agreement
from ecat.annotate.agreement.ratings import (
    Level,
    Patterns,
    categories_of,
    cohen_kappa,
    confusion,
    fleiss_kappa,
    krippendorff_alpha,
    observed_agreement,
)
from ecat.annotate.agreement.spans import Score

Figures = dict[str, Any]


def figures(agreement: Agreement) -> Figures:
    """All figures of layers compared; a coefficient that is not defined is None."""
    return {
        "raters": list(agreement.raters),
        "sessions": agreement.sessions,
        "frames": agreement.frames,
        "tiers": {name: coefficients(patterns) for name, patterns in agreement.labels.items()},
        "types": {name: coefficients(patterns) for name, patterns in agreement.types.items()},
        "events": [
            {"of": group, "name": name, "least_iou": least} | _score(score)
            for (group, name, least), score in sorted(agreement.spans.items())
        ],
        "edges": {tier: _edges(rows) for tier, rows in sorted(agreement.edges.items())},
        "parents": _score(agreement.parents),
        "roles": {name: _score(score) for name, score in sorted(agreement.roles.items())},
        "objects": _score(agreement.objects)
        | {
            "mean_iou": _number(float(np.mean(agreement.object_ious))) if agreement.object_ious else None,
            "same_name": _number(agreement.names.matched / agreement.names.first)
            if agreement.names.first
            else None,
        },
        "relations": {name: _score(score) for name, score in sorted(agreement.relations.items())},
    }


def coefficients(patterns: Patterns, level: Level = "nominal") -> Figures:
    """Chance-corrected agreement of patterns of ratings."""
    raters = max(map(len, patterns), default=0)
    found = {
        "items": sum(patterns.values()),
        "raters": raters,
        "observed": _number(observed_agreement(patterns)),
        "fleiss_kappa": _number(fleiss_kappa(patterns)),
        "krippendorff_alpha": _number(krippendorff_alpha(patterns, level=level)),
    }
    pairs = [cohen_kappa(pair_patterns(patterns, i, j)) for i, j in combinations(range(raters), 2)]
    defined = [kappa for kappa in pairs if not math.isnan(kappa)]
    return found | {"cohen_kappa": _number(float(np.mean(defined))) if defined else None}


def pair_patterns(patterns: Patterns, first: int, second: int) -> dict[tuple[Any, ...], int]:
    """The patterns of two of the raters."""
    found: dict[tuple[Any, ...], int] = {}
    for pattern, n in patterns.items():
        key = (pattern[first], pattern[second])
        found[key] = found.get(key, 0) + n
    return found


def confusion_figures(patterns: Patterns) -> Figures:
    """Truth against answers: the shares of each true label's answers, and how many are right."""
    labels = [str(label) for label in categories_of(patterns)]
    counts = confusion(patterns)
    total = float(counts.sum())
    return {
        "labels": labels,
        "rows": "truth",
        "columns": "answers",
        "counts": counts.astype(int).tolist(),
        "shares": [
            [round(share, 4) for share in row] for row in confusion(patterns, normalize=True).tolist()
        ],
        "accuracy": _number(float(np.trace(counts)) / total) if total else None,
    }


def _score(score: Score) -> Figures:
    return {
        "matched": score.matched,
        "first": score.first,
        "second": score.second,
        "f1": _number(score.f1),
    }


def _edges(rows: Sequence[tuple[int, int]]) -> Figures:
    late = np.array(rows, float).reshape(-1, 2)
    size = np.abs(late)
    return {
        "pairs": len(late),
        "median_frames": _number(float(np.median(size))),
        "percentile_90_frames": _number(float(np.percentile(size, 90))),
        "start_bias_frames": _number(float(late[:, 0].mean())),
        "end_bias_frames": _number(float(late[:, 1].mean())),
    }


def _number(value: float) -> float | None:
    return None if math.isnan(value) else round(value, 5)


def table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> list[str]:
    """Lines of a table: the first column to the left, the others to the right."""
    texts = [list(header), *([_cell(value) for value in row] for row in rows)]
    widths = [max(len(line[k]) for line in texts) for k in range(len(header))]
    return [
        "  "
        + "  ".join(
            cell.ljust(width) if k == 0 else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in texts
    ]


def _cell(value: object) -> str:
    if value is None:
        return "-"
    return f"{value:.3f}" if isinstance(value, float) else str(value)


def _counted(number: int, noun: str) -> str:
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def text_of(found: Figures) -> str:
    """The figures of :func:`figures` as a page."""
    raters = " and ".join(found["raters"])
    lines = [f"{raters}: {_counted(found['sessions'], 'session')}, {_counted(found['frames'], 'frame')}"]
    lines += _labels_text(found)
    lines += _events_text(found)
    lines += _objects_text(found)
    return "\n".join(lines)


def _labels_text(found: Figures) -> list[str]:
    header = ("labels by frame", "observed", "Cohen", "Fleiss", "Krippendorff")
    keys = ("observed", "cohen_kappa", "fleiss_kappa", "krippendorff_alpha")
    rows = [
        [f"{kind} {name or '(none)'}", *(of[key] for key in keys)]
        for kind, group in (("tier", found["tiers"]), ("type", found["types"]))
        for name, of in group.items()
    ]
    return ["", *table(header, rows)] if rows else []


def _events_text(found: Figures) -> list[str]:
    by_group: dict[tuple[str, str], dict[float, Mapping[str, Any]]] = {}
    for row in found["events"]:
        by_group.setdefault((row["of"], row["name"]), {})[row["least_iou"]] = row
    header = (
        "events",
        "first",
        "second",
        *(f"F1 at {least}" for least in LEAST_IOUS),
    )
    rows = [
        [
            group if group == name else f"{group} {name or '(none)'}",
            of[PAIRING_IOU]["first"],
            of[PAIRING_IOU]["second"],
            *(of[least]["f1"] for least in LEAST_IOUS),
        ]
        for (group, name), of in by_group.items()
    ]
    lines = ["", *table(header, rows)] if rows else []
    if found["edges"]:
        header = ("edges of paired events, frames", "pairs", "median", "90 %", "start later", "end later")
        keys = (
            "pairs", "median_frames", "percentile_90_frames", "start_bias_frames", "end_bias_frames",
        )  # fmt: skip
        rows = [
            [f"tier {name or '(none)'}", *(of[key] for key in keys)] for name, of in found["edges"].items()
        ]
        lines += ["", *table(header, rows)]
    return lines


def _objects_text(found: Figures) -> list[str]:
    header = ("what was said", "first", "second", "agreed", "F1")
    rows = [["objects", *_columns(found["objects"])]]
    rows += [[f"role {name}", *_columns(of)] for name, of in found["roles"].items()]
    if found["parents"]["first"] or found["parents"]["second"]:
        rows.append(["parent of paired sub-events", *_columns(found["parents"])])
    rows += [[f"relation {name}", *_columns(of)] for name, of in found["relations"].items()]
    lines = ["", *table(header, rows)]
    if found["objects"]["mean_iou"] is not None:
        iou, named = found["objects"]["mean_iou"], found["objects"]["same_name"]
        lines.append(f"  paired objects overlap by {iou:.3f} on average, {named:.0%} have the same name")
    return lines


def _columns(of: Mapping[str, Any]) -> list[object]:
    return [of["first"], of["second"], of["matched"], of["f1"]]


def ratings_text(found: Figures) -> str:
    """The figures of ratings in a table, as a page."""
    lines = [f"{_counted(found['items'], 'item')}, {_counted(found['raters'], 'rater')}"]
    if found["blank"]:
        lines.append(f"{found['blank']:,} ratings are blank and were left out (--blank LABEL counts them)")
    rows = [[name, found[key]] for key, name in _COEFFICIENTS.items()]
    lines += ["", *table(("agreement", ""), rows)]
    if "confusion" in found:
        of = found["confusion"]
        header = ("truth \\ answers", *(label or "(blank)" for label in of["labels"]))
        rows = [
            [label or "(blank)", *shares]
            for label, shares, counts in zip(of["labels"], of["shares"], of["counts"], strict=True)
            if any(counts)
        ]
        lines += ["", *table(header, rows), "", f"  right: {of['accuracy']:.1%}"]
    return "\n".join(lines)


_COEFFICIENTS = {
    "observed": "equal pairs of ratings",
    "cohen_kappa": "Cohen's kappa, mean of the pairs",
    "fleiss_kappa": "Fleiss' kappa",
    "krippendorff_alpha": "Krippendorff's alpha",
}
