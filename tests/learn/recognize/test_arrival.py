"""Trees that know by the way of a box when its action gets a locative."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from learn.features.journey import journey_features
from learn.features.windows import Table
from learn.recognize.arrival import arrival_width, arrived, grow_arrival
from learn.recognize.dataset import LabelledSession, read_exports
from learn.recognize.forest import Forest
from tests.learn.recognize import made

TABLE = Table(made.SLOPE, made.HEIGHT)


@pytest.fixture(scope="module")
def sessions(tmp_path_factory: pytest.TempPathFactory) -> list[LabelledSession]:
    return read_exports(made.exports(tmp_path_factory.mktemp("exports"), 4))


@pytest.fixture(scope="module")
def trees(sessions: list[LabelledSession]) -> Forest:
    grown = grow_arrival(sessions[:3] + sessions[5:], TABLE, seed=0)
    assert grown is not None
    return grown


def test_sessions_that_were_not_seen_arrive_when_they_do(
    trees: Forest, sessions: list[LabelledSession]
) -> None:
    for session in sessions[3:5]:
        related = session.labels[:, 4] > 0
        journeys = journey_features(session.points, TABLE)
        share = arrived(trees, [journeys], [session.labels[related][:1]])[0]
        assert share.shape == (len(session.labels), 1)
        assert share[related].min() > 0.5 > share[~related].max()


def test_each_label_is_asked_about_by_itself(trees: Forest, sessions: list[LabelledSession]) -> None:
    journeys = journey_features(sessions[3].points, TABLE)
    labels = np.stack([session.labels[-1] for session in sessions[2:6]])
    together = arrived(trees, [journeys], [labels])[0]
    apart = [arrived(trees, [journeys], [label[None]])[0][:, 0] for label in labels]
    np.testing.assert_array_equal(together, np.stack(apart, axis=1))


def test_sessions_are_asked_about_together(trees: Forest, sessions: list[LabelledSession]) -> None:
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
    grown = [grow_arrival(sessions, TABLE, seed) for seed in (1, 1, 2)]
    kept = [None if one is None else one.value.tolist() for one in grown]
    assert kept[0] == kept[1] != kept[2]


def test_sessions_that_never_arrive_teach_nothing(sessions: list[LabelledSession]) -> None:
    bare = [replace(one, labels=one.labels * [1, 1, 0, 1, 0]) for one in sessions]
    assert grow_arrival(bare, TABLE, seed=0) is None


def test_they_see_as_many_features_as_there_are(trees: Forest) -> None:
    assert trees.shape.tolist() == [arrival_width(), 1]
