"""Generative models: likelihoods are what counting gives, and what was learned is found again."""

from __future__ import annotations

from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal, norm

from ecat.errors import CorruptError, InputError
from learn.recognize.dataset import LabelledSession, read_exports
from learn.recognize.runs import Options, load, save, train
from learn.recognize.sequence import HiddenMarkov, LinearDynamics, motion
from tests.learn.recognize import made

GENERATOR = np.random.default_rng(0)


def test_likelihoods_of_hidden_markov_models_are_sums_over_all_paths() -> None:
    with np.errstate(divide="ignore"):
        transitions = np.log([[[0.7, 0.3, 0], [0, 0.6, 0.4], [0, 0, 1]]])
    model = HiddenMarkov(transitions, GENERATOR.normal(size=(1, 3, 2)), GENERATOR.uniform(0.5, 2, (1, 3, 2)))
    seen = GENERATOR.normal(size=(2, 4, 2))
    for row in range(2):
        paths: list[float] = []
        for path in product(range(3), repeat=3):
            states = (0, *path)
            moved = sum(transitions[0, a, b] for a, b in pairwise(states))
            emitted: Any = norm.logpdf(seen[row], model.means[0, states], np.sqrt(model.variances[0, states]))
            paths.append(float(moved + emitted.sum()))
        assert model.log_likelihood(seen)[row, 0] == pytest.approx(logsumexp(paths))


def test_likelihoods_of_linear_dynamics_are_products_over_steps() -> None:
    sequences = GENERATOR.normal(size=(30, 5, 2)).cumsum(axis=1)
    model = LinearDynamics.fit(sequences, np.zeros(30, np.int64), 1)
    one = sequences[3]
    noise, first = (factor[0] @ factor[0].T for factor in (model.factors, model.first))
    expected = multivariate_normal.logpdf(one[0], model.means[0], first)
    for before, after in pairwise(one):
        expected += multivariate_normal.logpdf(after, np.r_[before, 1] @ model.dynamics[0], noise)
    assert model.log_likelihood(sequences)[3, 0] == pytest.approx(expected)


def test_hidden_markov_models_find_the_stages_of_a_movement() -> None:
    stages = np.repeat([0.0, 3.0, -2.0], [4, 10, 6])
    sequences = np.concatenate([GENERATOR.normal(sign * stages, 0.1, (25, 20)) for sign in (1, -1)])[
        ..., None
    ]
    classes = np.repeat([0, 1], 25)
    model = HiddenMarkov.fit(sequences, classes, 2)
    np.testing.assert_allclose(model.means[..., 0], [[0, 3, -2], [0, -3, 2]], atol=0.1)
    np.testing.assert_array_equal(model.log_likelihood(sequences).argmax(axis=1), classes)


def test_linear_dynamics_tell_growth_from_decay() -> None:
    start = GENERATOR.normal(0, 1, (400, 1, 1))
    growth = start * 1.1 ** np.arange(20)[:, None]
    decay = start * 0.9 ** np.arange(20)[:, None]
    noisy = np.concatenate([growth, decay]) + GENERATOR.normal(0, 1e-2, (800, 20, 1))
    classes = np.repeat([0, 1], 400)
    model = LinearDynamics.fit(noisy, classes, 2)
    assert model.dynamics[0, 0, 0] > 1 > model.dynamics[1, 0, 0]
    assert (model.log_likelihood(noisy).argmax(axis=1) == classes).mean() > 0.8


def test_motion_is_distances_their_growth_and_the_way_of_boxes() -> None:
    places = np.zeros((1, 20, 18), np.float32)
    places[0, :, 6] = np.arange(20) / 10
    found = motion(places)
    assert found.shape == (1, 20, 22)
    np.testing.assert_allclose(found[0, :, 6], np.arange(20) / 10, atol=1e-6)
    np.testing.assert_allclose(found[0, :, 15], 0.1, atol=1e-6)
    np.testing.assert_allclose(found[0, :, 18:], [[0.1, 0, 0, 0]] * 20, atol=1e-6)


@pytest.fixture(scope="module")
def sessions(tmp_path_factory: pytest.TempPathFactory) -> list[LabelledSession]:
    return read_exports(made.exports(tmp_path_factory.mktemp("exports")))


@pytest.mark.parametrize("kind", ["hmm", "lds"])
def test_models_are_kept_and_read_again(kind: str, sessions: list[LabelledSession], tmp_path: Path) -> None:
    recognizer, _ = train(kind, sessions, Options())
    points = [session.points for session in sessions]
    found = recognizer.recognize(points)
    true = np.concatenate([session.labels for session in sessions])
    assert (found.labels(found.alone) == true).all(axis=1).mean() > 0.8
    save(recognizer, tmp_path)
    np.testing.assert_array_equal(load(tmp_path).recognize(points).alone, found.alone)
    assert recognizer.recognize([]).alone.shape[0] == 0


def test_nothing_to_learn_from_is_refused() -> None:
    with pytest.raises(InputError, match="cannot train"):
        train("hmm", [], Options())


@pytest.mark.parametrize("damage", [b"", b"PK\x03\x04", b"\x80\x04K\x01."])
def test_damaged_models_are_one_error(damage: bytes, sessions: list[LabelledSession], tmp_path: Path) -> None:
    recognizer, _ = train("lds", sessions, Options())
    save(recognizer, tmp_path)
    (tmp_path / "sequences.npz").write_bytes(damage)
    with pytest.raises(CorruptError):
        load(tmp_path)
