"""Recognisers that are networks: those of the thesis by name, and the one that sees raw joints and markers."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ecat.errors import InputError
from ecat.progress import Progress, silent
from learn.features.raw import MIRROR_CHANNELS, MIRROR_SIGNS, VERSION
from learn.features.windows import Floats, Table
from learn.recognize.context import in_context
from learn.recognize.dataset import LabelledSession, Labels, vocabulary_of
from learn.recognize.folds import Key
from learn.recognize.grammar import Habits
from learn.recognize.inputs import SHAPES, Fitted
from learn.recognize.model import N_JOBS, Recognized, fingerprint
from learn.recognize.neural.checkpoints import read_tensors, write_tensors
from learn.recognize.neural.examples import Augment, dense, held_out, twice
from learn.recognize.neural.networks import SIZES, Dense, Ensemble, RawNetwork, SlotLSTM, SlotNetwork
from learn.recognize.neural.training import History, Settings, fit, forget, one_thread
from learn.recognize.unusable import check_name, habits_of, labels_of, prints_of, undamaged

FEATURES = {
    "mlp": "ch4-event75",
    "quant-lstm": "ch4-pcas18",
    "quant-lstm-crf": "ch4-pcas18",
    "qual-lstm-crf": "ch4-qsr25",
    "sparse-lstm-crf": "ch4-sparse522",
    "neural": VERSION,
}
"""What each model sees."""
RECIPES = {
    **{name: Settings(name) for name in FEATURES},
    "neural": Settings(
        "neural",
        hidden=96,
        epochs=4,
        batch=128,
        rate=2e-3,
        decay=0,
        keep=0.8,
        members=2,
        step=1,
        durations=(0.83, 1.0, 1.2),
        validation=0,
    ),
}
"""How each is trained if nothing else is said: the smallest of the thesis' grid."""
NETWORK = "network.npz"
MOST = {"hidden": 4096, "layers": 8, "members": 16}
"""Of sizes of a network, which the command line also allows no more of."""
_CHUNK = 256
_EVERY: Labels = np.array(list(product(*(range(size) for size in SIZES))), np.int8)


@dataclass(frozen=True)
class NeuralRecognizer:
    """A trained network.

    Attributes
    ----------
    vocabulary : (k, 5) labels that it gives probabilities of: all there are, or those of the training sessions.
    seen : those of the training sessions, with both names of the boxes.
    trained_on : fingerprints of these sessions.
    """

    settings: Settings
    fitted: Fitted
    vocabulary: Labels
    seen: Labels
    habits: Habits
    network: Any
    trained_on: frozenset[str] = frozenset()

    def on_table(self, table: Table) -> NeuralRecognizer:
        """The same for sessions whose table is known."""
        return replace(self, fitted=self.fitted.on_table(table))

    def recognize(self, sessions: Sequence[Floats]) -> Recognized:
        """What the windows of sessions, each of points (n, 21, 3), show."""
        found = self.alone(sessions)
        return in_context(self.vocabulary, found, sessions, self.seen, self.habits)

    def alone(self, sessions: Sequence[Floats], *, thorough: bool = True) -> Floats:
        """Probabilities (w, k) of windows without their session.

        Parameters
        ----------
        thorough : every member of the raw network sees both sides of a mirror, and not every other one the same side.
        """
        if sessions:
            inputs = torch.from_numpy(np.concatenate([self.fitted.windows(points) for points in sessions]))
        else:
            inputs = torch.zeros(0, *SHAPES[self.fitted.name])
        if self.settings.model == "neural":
            return raw_probabilities(self.network, inputs, self.vocabulary, thorough=thorough)
        return slot_probabilities(self.network, inputs, self.vocabulary, self.settings)


@dataclass(frozen=True)
class Trained:
    """A recogniser, how its training went, and the sessions that said when to stop."""

    recognizer: NeuralRecognizer
    history: History
    validation: list[Key]


def train(
    sessions: Sequence[LabelledSession],
    settings: Settings,
    *,
    fit_to: Sequence[LabelledSession] | None = None,
    checkpoint: Path | None = None,
    progress: Progress = silent,
) -> Trained:
    """A network that has seen these sessions and nothing else.

    Parameters
    ----------
    fit_to : sessions that the features are fitted to, if not those that are trained on: the thesis' program fitted them
        to all, tested ones too.
    checkpoint : a file that is written after every epoch, and from which training goes on.

    Raises
    ------
    InputError : there are no windows; or the checkpoint is of other settings or sessions.
    """
    if not sum(len(session.labels) for session in sessions):
        raise InputError("cannot train a recogniser", where="there are no windows", fix="give more sessions")
    sessions = [session for session in sessions if len(session.labels)]
    known, held = held_out(sessions, settings)
    seen = vocabulary_of(sessions)
    whole = settings.model == "neural"
    fitted = Fitted.of(
        FEATURES[settings.model], [one.points for one in (known if fit_to is None else fit_to)]
    )
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(settings.seed)
        network = _network(settings, seen)
        habits = Habits.of([session.labels for session in known])
        vocabulary = seen if whole else _EVERY
        prints = frozenset(fingerprint(session.points) for session in sessions)
        recognizer = NeuralRecognizer(settings, fitted, vocabulary, seen, habits, network, prints)
        if whole:
            inputs, targets = dense(known, fitted, seen, settings, progress)
        else:
            inputs, targets = twice(known, fitted, progress)
        history = fit(
            network,
            inputs,
            targets,
            settings,
            augment=Augment() if whole else None,
            validate=_validation(recognizer, held),
            checkpoint=checkpoint,
            identity=_identity(sessions, settings, fitted),
            progress=progress,
        )
    return Trained(recognizer, history, [session.key for session in held])


def slot_probabilities(network: Any, inputs: Tensor, vocabulary: Labels, settings: Settings) -> Floats:
    """Probabilities (w, k) of labels (k, 5) by a network of the thesis."""
    network.eval()
    if network.crf is not None:
        network.crf.weight = settings.crf_weight
    found = _by_chunks(network, inputs, torch.from_numpy(vocabulary), 10 if settings.carries else _CHUNK)
    if network.crf is not None:
        network.crf.weight = 1.0
    return found


def raw_probabilities(network: Any, inputs: Tensor, vocabulary: Labels, *, thorough: bool = True) -> Floats:
    """Probabilities (w, k) of labels (k, 5): the mean over members and both sides of a mirror."""
    network.eval()
    labels, signs = torch.from_numpy(vocabulary), torch.from_numpy(MIRROR_SIGNS)
    asked = [
        (member, side)
        for number, member in enumerate(network.members)
        for side in ((0, 1) if thorough else (number % 2,))
    ]

    def said(start: int) -> Floats:
        seen = inputs[start : start + _CHUNK]
        sides = seen, seen[..., MIRROR_CHANNELS] * signs
        with torch.inference_mode():
            found = [member.log_probabilities(sides[side], labels).exp() for member, side in asked]
            return torch.stack(found).mean(0).double().numpy()

    with (
        one_thread(),
        ThreadPoolExecutor(N_JOBS, initializer=torch.set_num_threads, initargs=(1,)) as threads,
    ):
        parts = list(threads.map(said, range(0, len(inputs), _CHUNK)))
    return np.concatenate([*parts, np.zeros((0, len(vocabulary)))])


def save(recognizer: NeuralRecognizer, run: Path) -> dict[str, Any]:
    """Write the network into the folder ``run``, as arrays, and say what else is to be kept, as JSON.

    Raises
    ------
    InputError : a number of it is not known (NaN).
    StoreError : it cannot be written.
    """
    write_tensors(run / NETWORK, recognizer.network.state_dict())
    return {
        "model": recognizer.settings.model,
        "features": recognizer.fitted.name,
        "fit": recognizer.fitted.fit.tolist(),
        "settings": asdict(recognizer.settings),
        "vocabulary": recognizer.seen.tolist(),
        "habits": asdict(recognizer.habits),
        "trained_on": sorted(recognizer.trained_on),
    }


def load(run: Path, config: Mapping[str, Any]) -> NeuralRecognizer:
    """The recogniser in the folder ``run``, with what :func:`save` said; nothing in it is executed.

    Raises
    ------
    InputError : it was trained with other features.
    CorruptError : it is damaged.
    """
    with undamaged(f"cannot use the model {run}"):
        check_name(config["features"], FEATURES[config["model"]], run)
        settings, seen = settings_of(config), labels_of(config)
        vocabulary = seen if settings.model == "neural" else _EVERY
        fitted = Fitted(config["features"], np.array(config["fit"], np.float64))
        network = _read_network(run / NETWORK, settings, seen)
        habits, known = habits_of(config), prints_of(config)
        found = NeuralRecognizer(settings, fitted, vocabulary, seen, habits, network, known)
    network.eval()
    return found


def settings_of(config: Mapping[str, Any]) -> Settings:
    """The settings that a network was trained with, as far as they say what it is and how it is asked.

    Raises
    ------
    ValueError : they are of another model, or larger than what is trained.
    TypeError : they are others, or of another type.
    """
    found = Settings(**config["settings"])
    found = replace(found, durations=tuple(found.durations))
    sizes = {name: getattr(found, name) for name in MOST}
    wrong = [name for name, size in sizes.items() if type(size) is not int or not 1 <= size <= MOST[name]]
    if found.model != config["model"]:
        wrong.append("model")
    if not 0 < found.keep <= 1:
        wrong.append("keep")
    if type(found.carries) is not bool:
        wrong.append("carries")
    if not math.isfinite(found.crf_weight):
        wrong.append("crf_weight")
    if wrong:
        raise ValueError(f"its settings cannot be: {', '.join(wrong)}")
    return found


def _read_network(source: Path, settings: Settings, vocabulary: Labels) -> Any:
    """Before a network is made, it is known that the file has all numbers for it, and no others."""
    with torch.device("meta"):
        expected = _network(settings, vocabulary).state_dict()
    tensors, _ = read_tensors(source, expected)
    for name, value in expected.items():
        kept = tensors.get(name)
        if kept is None or (kept.shape, kept.dtype) != (value.shape, value.dtype):
            raise ValueError(f"its network does not fit its settings: {name}")
        if not kept.isfinite().all():
            raise ValueError(f"its network has numbers that are not finite: {name}")
    network = _network(settings, vocabulary)
    network.load_state_dict(tensors)
    return network


def _network(settings: Settings, vocabulary: Labels) -> Any:
    name, hidden, keep = settings.model, settings.hidden, settings.keep
    if name == "neural":
        return Ensemble([RawNetwork(vocabulary, hidden, 1 - keep) for _ in range(settings.members)])
    n_inputs = SHAPES[FEATURES[name]][-1]
    if name == "mlp":
        return SlotNetwork(Dense(n_inputs, hidden, keep), hidden, crf=False)
    body = SlotLSTM(n_inputs, hidden, settings.layers, keep, carries=settings.carries)
    return SlotNetwork(body, hidden, crf=name.endswith("-crf"))


def _by_chunks(network: Any, inputs: Tensor, labels: Tensor, size: int) -> Floats:
    forget(network)
    with torch.no_grad():
        parts = [
            network.log_probabilities(inputs[start : start + size], labels).exp().double().numpy()
            for start in range(0, len(inputs), size)
        ]
    forget(network)
    return np.concatenate(parts) if parts else np.zeros((0, len(labels)))


def _validation(recognizer: NeuralRecognizer, held: Sequence[LabelledSession]) -> Any:
    if not held:
        return None
    inputs = torch.from_numpy(np.concatenate([recognizer.fitted.windows(one.points) for one in held]))
    true = np.concatenate([one.labels for one in held])
    settings = replace(recognizer.settings, carries=False)

    def score() -> float:
        ask = (
            raw_probabilities
            if settings.model == "neural"
            else partial(slot_probabilities, settings=settings)
        )
        found = ask(recognizer.network, inputs, recognizer.vocabulary)
        return float((recognizer.vocabulary[found.argmax(axis=1)] == true).all(axis=1).mean())

    return score


def _identity(sessions: Sequence[LabelledSession], settings: Settings, fitted: Fitted) -> str:
    """Changes when anything does that training depends on."""
    digest = hashlib.sha256(repr((settings, fitted.name, fitted.fit.tolist())).encode())
    for session in sessions:
        digest.update(session.content)
    return digest.hexdigest()
