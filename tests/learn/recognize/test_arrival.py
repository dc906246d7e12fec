"""Trees that know by the way of a box when its action gets a locative."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ecat.errors import CorruptError
from learn.features.journey import journey_features
from learn.features.windows import Table
from learn.recognize.arrival import Shares, arrival_width, arrived, grow
from learn.recognize.dataset import LabelledSession, read_exports
from tests.learn.recognize import made

TABLE = Table(made.SLOPE, made.HEIGHT)


@pytest.fixture(scope="module")
def sessions(tmp_path_factory: pytest.TempPathFactory) -> list[LabelledSession]:
    return read_exports(made.exports(tmp_path_factory.mktemp("exports"), 4))


@pytest.fixture(scope="module")
def trees(sessions: list[LabelledSession]) -> Shares:
    grown = grow(sessions[:3] + sessions[5:], TABLE, seed=0)
    assert grown is not None
    return grown


def test_sessions_that_were_not_seen_arrive_when_they_do(
    trees: Shares, sessions: list[LabelledSession]
) -> None:
    for session in sessions[3:5]:
        related = session.labels[:, 4] > 0
        journeys = journey_features(session.points, TABLE)
        share = arrived(trees, [journeys], [session.labels[related][:1]])[0]
        assert share.shape == (len(session.labels), 1)
        assert share[related].min() > 0.5 > share[~related].max()


def test_each_label_is_asked_about_by_itself(trees: Shares, sessions: list[LabelledSession]) -> None:
    journeys = journey_features(sessions[3].points, TABLE)
    labels = np.stack([session.labels[-1] for session in sessions[2:6]])
    together = arrived(trees, [journeys], [labels])[0]
    apart = [arrived(trees, [journeys], [label[None]])[0][:, 0] for label in labels]
    np.testing.assert_array_equal(together, np.stack(apart, axis=1))


def test_sessions_are_asked_about_together(trees: Shares, sessions: list[LabelledSession]) -> None:
    journeys = [journey_features(session.points, TABLE) for session in sessions[:3]]
    labels = [
        sessions[0].labels[-1:],
        sessions[0].labels[:0],
        np.stack([one.labels[-1] for one in sessions[1:3]]),
    ]
    together = arrived(trees, journeys, labels)
    assert [one.shape[1] for one in together] == [1, 0, 2]
    for journey, asked, said in zip(journeys, labels, together, strict=True):
        np.testing.assert_array_equal(said, arrived(trees, [journey], [asked])[0])


def test_the_same_seed_grows_the_same_trees(sessions: list[LabelledSession]) -> None:
    grown = [grow(sessions, TABLE, seed) for seed in (1, 1, 2)]
    kept = [None if one is None else one.value.tolist() for one in grown]
    assert kept[0] == kept[1] != kept[2]


def test_sessions_that_never_arrive_teach_nothing(sessions: list[LabelledSession]) -> None:
    bare = [replace(one, labels=one.labels * [1, 1, 0, 1, 0]) for one in sessions]
    assert grow(bare, TABLE, seed=0) is None


def test_they_see_as_many_features_as_there_are(trees: Shares) -> None:
    assert trees.shape.tolist() == [arrival_width(), 1]


def test_they_are_read_as_they_were_written(trees: Shares, tmp_path: Path) -> None:
    np.savez(tmp_path / "t.npz", allow_pickle=False, **trees.arrays("t"))
    with np.load(tmp_path / "t.npz") as arrays:
        again = Shares.of_arrays(arrays, "t")
    rows = np.random.default_rng(0).normal(size=(20, int(trees.shape[0]))).astype(np.float32)
    np.testing.assert_array_equal(again.predict(rows), trees.predict(rows))


@pytest.mark.parametrize("wrong", [-0.1, 1.1, np.nan])
def test_what_is_no_probability_is_refused(wrong: float, trees: Shares) -> None:
    arrays = trees.arrays("t")
    arrays["t.value"] = np.where(np.arange(len(trees.value)) == 5, wrong, trees.value)
    with pytest.raises(CorruptError):
        Shares.of_arrays(arrays, "t")
