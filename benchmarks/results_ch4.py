"""Recognition of actions: the thesis (chapter 4), the same models trained again, and ours, side by side.

    python benchmarks/results_ch4.py DIR --run RUN [--seeds 3] [--models ...] [--folds random|blocks|both]

DIR holds learning exports.  Each model is trained on the folds that come with ecat, fold by fold; what is finished is
kept in RUN and not computed again, so that it can be interrupted.  A report is printed as Markdown; RUN gets report.md,
report.json, and a picture of the confusions of each model.

``thesis`` among the protocols is that of the thesis' program, as far as it can be rebuilt: of every file 60 % of the
sessions to learn from and 40 % to test, drawn once (here by a seed; it had none), features fitted to all sessions, also
those that are tested, states carried from one batch to the next, and half the weight for pairs of slots when testing.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from ecat.progress import Progress
from learn.recognize.baselines import BASELINES
from learn.recognize.crossval import (
    Recognize,
    Split,
    in_order,
    kept_or,
    made_of,
    recognized_by,
    splits_of,
    summary,
)
from learn.recognize.dataset import SLOTS, LabelledSession, read_exports
from learn.recognize.evaluation import WAYS, Predicted, draw_confusions, predicted, score, scores
from learn.recognize.folds import Kind
from learn.recognize.neural.training import Settings
from learn.recognize.runs import MODELS, Options

THESIS: dict[str, float] = {
    "marginals": 6,
    "quant-lstm": 39,
    "quant-lstm-crf": 48,
    "qual-lstm-crf": 60,
}
"""Shares of windows, in per cent, that the thesis reports; for its baseline, each slot is drawn by itself."""
THESIS_SLOTS = {"qual-lstm-crf": (93, 90, 80, 83, 82)}
NETWORKS = tuple(name for name in MODELS if name not in ("trees", "hmm", "lds", "neural", "mixture"))
TRAINED_ON = 0.6
CARRIED = ("quant-lstm", "quant-lstm-crf", "qual-lstm-crf", "sparse-lstm-crf")


@dataclass(frozen=True)
class Job:
    """A model on one split of the sessions."""

    model: str
    protocol: str
    options: Options
    fold: int
    split: Split
    recognize: Recognize

    @property
    def what(self) -> str:
        """Its name for people."""
        return f"{self.model}, {self.protocol}, seed {self.options.seed}, fold {self.fold + 1}"

    @property
    def file(self) -> str:
        """Where what it said is kept."""
        return f"{self.model}-{self.protocol}-{self.options.seed}-{self.fold}.npz"


def thesis_split(sessions: Sequence[LabelledSession], seed: int) -> Split:
    """Of every file 60 % of its sessions, shuffled, and the rest."""
    generator = np.random.default_rng(seed)
    known: set[tuple[str, str]] = set()
    for file in sorted({one.file for one in sessions}):
        keys = [one.key for one in sessions if one.file == file]
        order = generator.permutation(len(keys)).tolist()
        known.update(keys[place] for place in order[: int(TRAINED_ON * len(keys))])
    return [one for one in sessions if one.key in known], [one for one in sessions if one.key not in known]


def as_in_the_thesis(name: str, options: Options, sessions: Sequence[LabelledSession]) -> Recognize:
    """Its program: features fitted to all ``sessions``, states carried, half the weight for pairs when testing."""
    from learn.recognize.neural import recognizer as neural

    def recognize(split: Split, progress: Progress) -> Predicted:
        settings = replace(options.of_network(name), carries=name in CARRIED, crf_weight=0.5, validation=0.0)
        found = neural.train(split[0], settings, fit_to=sessions, progress=progress).recognizer
        return predicted(split[1], found.recognize([one.points for one in split[1]]))

    return recognize


def jobs_of(sessions: Sequence[LabelledSession], given: argparse.Namespace) -> list[Job]:
    """All that is to be done: seed by seed, and fold by fold, so that all models have a figure early."""
    found: list[Job] = []
    kinds: list[Kind] = ["random", "blocks"] if given.folds == "both" else [given.folds]
    for seed in range(given.seeds):
        options = {name: options_of(name, seed, given) for name in given.models}
        for kind in kinds:
            found += [
                Job(name, kind, one, fold, split, recognized_by(name, one))
                for fold, split in enumerate(splits_of(sessions, kind))
                for name, one in options.items()
            ]
        split = thesis_split(sessions, seed)
        found += [
            Job(name, "thesis", one, 0, split, as_in_the_thesis(name, one, sessions))
            for name, one in options.items()
            if given.thesis and name in NETWORKS
        ]
    return found


def options_of(name: str, seed: int, given: argparse.Namespace) -> Options:
    """Sizes are said for the thesis' networks only; ours is trained as it is."""
    if name in ("trees", "mixture"):
        return Options(seed=seed, trees=given.trees)
    if name not in NETWORKS:
        return Options(seed=seed)
    layers = None if name == "mlp" else given.layers
    return Options(seed=seed, epochs=given.epochs, hidden=given.hidden, layers=layers, rate=given.rate)


def run(jobs: Sequence[Job], folder: Path) -> list[tuple[Job, Predicted]]:
    """Do what is not done yet, and say how long the rest will take."""
    found: list[tuple[Job, Predicted]] = []
    spent: dict[str, list[float]] = {}
    for done, job in enumerate(jobs):
        started = time.monotonic()
        found.append(
            (
                job,
                kept_or(
                    job.recognize,
                    job.split,
                    folder / job.file,
                    made_of(job.model, job.options) + job.protocol,
                ),
            )
        )
        took = time.monotonic() - started
        if took > 1:
            spent.setdefault(job.model, []).append(took)
        usual = float(np.mean([one for times in spent.values() for one in times])) if spent else 0.0
        left = sum(float(np.mean(spent.get(other.model, [usual]))) for other in jobs[done + 1 :])
        right = score(found[-1][1].true, found[-1][1].labels["windows"])["tuple"]
        print(
            f"{done + 1}/{len(jobs)} {job.what}: {100 * right:.1f} % in {took:.0f} s; about {left / 60:.0f} min left",
            file=sys.stderr,
            flush=True,
        )
    return found


def collected(
    found: Sequence[tuple[Job, Predicted]], sessions: Sequence[LabelledSession], folder: Path
) -> list[dict[str, Any]]:
    """Scores of each model under each protocol, and a picture of what its first seed took for what."""
    groups: dict[tuple[str, str], dict[int, list[Predicted]]] = {}
    for job, said in found:
        groups.setdefault((job.model, job.protocol), {}).setdefault(job.options.seed, []).append(said)
    rows: list[dict[str, Any]] = []
    for (name, protocol), seeds in groups.items():
        whole = {
            seed: parts[0] if protocol == "thesis" else in_order(parts, sessions)
            for seed, parts in seeds.items()
        }
        for way in WAYS:
            draw_confusions(next(iter(whole.values())), way, folder / f"{name}-{protocol}-{way}.png")
        scored = summary(list(whole), [scores(one) for one in whole.values()])
        rows.append({"model": name, "protocol": protocol, **scored})
    return rows


def baselines(sessions: Sequence[LabelledSession], kind: Kind) -> dict[str, Any]:
    """Scores of what knows less, on the same folds."""
    splits = splits_of(sessions, kind)
    true = np.concatenate([one.labels for _, tested in splits for one in tested])
    return {
        name: score(true, np.concatenate([baseline(*split) for split in splits]))
        for name, baseline in BASELINES.items()
    }


def report(rows: Sequence[dict[str, Any]], known: dict[str, Any], given: argparse.Namespace) -> str:
    """The tables, as Markdown."""
    titles = ["model", "protocol", "thesis", "windows alone", *SLOTS, "with context"]
    lines = [f"| {' | '.join(titles)} |", f"|{'---|' * len(titles)}"]
    lines += [_row(name, f"{given.folds} folds", [one], "-") for name, one in known.items()]
    for row in rows:
        protocol = "thesis' own" if row["protocol"] == "thesis" else f"{row['protocol']} folds"
        runs = list(row["runs"].values())
        spread = f" ± {100 * row['spread']['windows']:.1f}" if len(runs) > 1 else ""
        context = f"{100 * row['mean']['context']:.1f}"
        lines.append(_row(row["model"], protocol, [one["windows"] for one in runs], context, spread))
    for name, slots in THESIS_SLOTS.items():
        lines.append(f"| {name} | as reported | {THESIS[name]:.0f} | | {' | '.join(map(str, slots))} | |")
    return "\n".join([*lines, *_trusted(rows), "", *_notes(given)]) + "\n"


def _trusted(rows: Sequence[dict[str, Any]]) -> list[str]:
    lines = ["", "Without the ten sessions whose labels look inverted:", ""]
    lines += ["| model | protocol | windows alone | with context |", "|---|---|---|---|"]
    for row in rows:
        parts = [one["without_suspicious"] for one in row["runs"].values() if "without_suspicious" in one]
        if parts:
            means = [100 * np.mean([part[way]["tuple"] for part in parts]) for way in WAYS]
            lines.append(f"| {row['model']} | {row['protocol']} | {means[0]:.1f} | {means[1]:.1f} |")
    return lines


def _notes(given: argparse.Namespace) -> list[str]:
    usual = Settings("")
    size = f"{given.layers or usual.layers} layer(s) of {given.hidden or usual.hidden}"
    how = f"at most {given.epochs or usual.epochs} epochs at a rate of {given.rate or usual.rate}"
    return [
        f"Per cent of windows; mean over {given.seeds} seed(s) ± standard deviation. The thesis' networks have {size},",
        f"{how}; the thesis tried up to 2 layers of 400 and 200 epochs, rates of 0.05 to 0.5, and reports the best.",
        "On folds, states are not carried from batch to batch, windows are shuffled, a tenth of the training sessions",
        "says when to stop, pairs of slots keep their weight, and nothing is fitted to a session that is tested.",
        "The thesis' own protocol leaks: its features are fitted to the tested sessions too, and there is no third",
        "part on which settings were chosen. Its last windows that fill no batch were not tested; here they are.",
    ]


def _row(name: str, protocol: str, runs: Sequence[dict[str, Any]], context: str, spread: str = "") -> str:
    thesis = f"{THESIS[name]:.0f}" if name in THESIS else "-"
    right = 100 * float(np.mean([one["tuple"] for one in runs]))
    slots = [f"{100 * np.mean([one['slots'][slot] for one in runs]):.1f}" for slot in runs[0]["slots"]]
    return f"| {name} | {protocol} | {thesis} | {right:.1f}{spread} | {' | '.join(slots)} | {context} |"


def arguments() -> argparse.Namespace:
    """What was asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("source", type=Path)
    parser.add_argument("--run", type=Path, default=Path("build/results-ch4"))
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--models", nargs="+", choices=MODELS, default=list(MODELS))
    parser.add_argument("--folds", choices=("random", "blocks", "both"), default="random")
    parser.add_argument("--hidden", type=int, help="units of the thesis' networks, 200 if not given")
    parser.add_argument("--layers", type=int, help="layers of the thesis' LSTMs, 1 if not given")
    parser.add_argument("--epochs", type=int, help="of the thesis' networks, 100 if not given")
    parser.add_argument("--rate", type=float, help="at which the thesis' networks learn, 0.2 if not given")
    parser.add_argument("--trees", type=int, help="of the best recogniser, of each class in each model")
    parser.add_argument(
        "--no-thesis", dest="thesis", action="store_false", help="leave out the thesis' protocol"
    )
    parser.add_argument("--no-baselines", dest="baselines", action="store_false")
    return parser.parse_args()


def main() -> None:
    """Train, recognise, report."""
    given = arguments()
    sessions = read_exports(given.source)
    given.run.mkdir(parents=True, exist_ok=True)
    found = run(jobs_of(sessions, given), given.run)
    rows = collected(found, sessions, given.run)
    kind: Kind = "blocks" if given.folds == "blocks" else "random"
    known = baselines(sessions, kind) if given.baselines else {}
    text = report(rows, known, given)
    (given.run / "report.md").write_text(text, "utf-8")
    data = {"rows": rows, "baselines": known, "options": asdict(options_of("qual-lstm-crf", 0, given))}
    (given.run / "report.json").write_text(json.dumps(data, indent=1) + "\n", "utf-8")
    print(text)


if __name__ == "__main__":
    main()
