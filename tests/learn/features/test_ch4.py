"""The features of chapter 4 equal what its program stored."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from numpy.typing import NDArray

from ecat.errors import InputError
from ecat.formats.ecat2018.learning_export import read_learning_export
from ecat.formats.recordings.learning_sessions import draft_of
from ecat.store import create_session
from learn.features import ch4
from learn.features.ch4 import Projection, Projections
from learn.features.points import SWAP_POINTS
from learn.features.recordings import read_session

Floats = NDArray[np.float64]


@pytest.fixture(scope="module")
def actions(shared: Path) -> Path:
    if not (shared / "actions_ch4").is_dir():
        pytest.skip("actions_ch4 is not in the reference data")
    return shared / "actions_ch4"


@pytest.fixture(scope="module")
def projections(actions: Path) -> Projections:
    fits = json.loads((actions / "pca_fits.json").read_text("utf-8"))
    inter, intra = (
        Projection(np.array(fits[name]["mean"]), np.array(fits[name]["components"]))
        for name in ("inter_object", "intra_object")
    )
    return Projections(inter, intra)


def table(path: Path) -> pd.DataFrame:
    frame = pq.read_table(path).to_pandas()
    return frame.astype(dict.fromkeys(("project", "session"), "str"))


def places_of_sessions(actions: Path) -> Iterator[tuple[tuple[str, str], Floats]]:
    rows = table(actions / "pca18_features.parquet")
    for key, each in rows.groupby(["project", "session"], sort=False):
        yield (str(key[0]), str(key[1])), each[list(ch4.PCAS_COLUMNS)].to_numpy()


def test_relations_of_every_session_equal_those_that_were_stored(actions: Path) -> None:
    stored = table(actions / "pickle_qsr.parquet")
    by_session = dict(iter(stored.groupby(["project", "session", "reversed"])))
    compared = 0
    for key, places in places_of_sessions(actions):
        found = ch4.qsr25(places)
        said = by_session[(*key, False)][list(ch4.QSR_COLUMNS)].to_numpy()
        assert np.array_equal(found, said), key
        compared += len(found)
        if (exchanged := by_session.get((*key, True))) is not None:
            assert np.array_equal(found[:, ch4.SWAP_QSR], exchanged[list(ch4.QSR_COLUMNS)].to_numpy()), key
    assert compared > 25_000


def test_the_stored_features_of_events_are_those_of_whole_sessions(actions: Path) -> None:
    stored = table(actions / "pickle_event.parquet")
    rows = {key: ch4.qsr25(places) for key, places in places_of_sessions(actions)}
    compared = 0
    for row in stored.to_dict("records"):
        features = rows[row["project"], row["session"]]
        features = features[:, ch4.SWAP_QSR] if row["reversed"] else features
        assert ch4.event75(features).tolist() == [row[name] for name in ch4.EVENT_COLUMNS]
        compared += 1
    assert compared > 400


@pytest.mark.parametrize("project", ["pullto", "selfrollfrom"])
def test_places_and_relations_follow_from_the_recording(
    actions: Path, projections: Projections, project: str, tmp_path: Path
) -> None:
    stored = table(actions / "pca18_features.parquet").query(f"project == {project!r}")
    compared = 0
    for number, one in enumerate(read_learning_export(actions / "xml" / f"{project}.txt")):
        if one.empty or number % 8:
            continue
        session = create_session(tmp_path / str(number), draft_of(one, "one", project, {}))
        places = ch4.pcas(read_session(session).points, projections)
        said = stored[stored["session"] == one.name][list(ch4.PCAS_COLUMNS)].to_numpy()
        np.testing.assert_allclose(places, said, rtol=0, atol=1e-13)
        assert np.array_equal(ch4.qsr25(places), ch4.qsr25(said))
        compared += 1
    assert compared >= 2


# --- without reference data


def frames(n: int = 30, seed: int = 0) -> Floats:
    """Points that walk."""
    steps = np.random.default_rng(seed).normal(0, 0.02, (n, 21, 3)) * [1, 0.6, 0.2]
    steps[0] += np.random.default_rng(seed + 1).normal(0, 0.5, (21, 3))
    return np.cumsum(steps, axis=0)


def test_planes_are_those_of_most_variance_and_point_to_the_farthest() -> None:
    points = frames().reshape(-1, 3)
    plane = ch4.fit_projection(points)
    scores = plane(points)
    assert np.allclose(plane.components @ plane.components.T, np.eye(2))
    assert np.allclose(scores.mean(axis=0), 0)
    assert (scores[np.abs(scores).argmax(axis=0), [0, 1]] > 0).all()
    total = np.linalg.eigvalsh(np.cov(points.T))[::-1]
    assert np.allclose(scores.var(axis=0, ddof=1), total[:2])


@pytest.mark.slow
def test_planes_fitted_to_the_data_are_nearly_those_of_the_original(
    actions: Path, projections: Projections
) -> None:
    """Which were fitted to a few more; in one of these is the point that decides where an axis points."""
    exports = [one for path in sorted((actions / "xml").glob("*.txt")) for one in read_learning_export(path)]
    corners, joints = (
        np.concatenate([np.array([each[axis].to_numpy() for axis in "xyz"]).T for each in tables])
        for tables in ([one.boxes for one in exports], [one.joints for one in exports])
    )
    everything = np.concatenate([joints, corners])
    for points, plane in ((everything, projections.inter), (corners, projections.intra)):
        fitted = ch4.fit_projection(points * [-1, -1, 1])
        assert np.abs(np.diag(fitted.components @ plane.components.T)).min() > 0.999
        np.testing.assert_allclose(fitted.mean, plane.mean, atol=0.01)


def test_exchanging_the_boxes_before_is_exchanging_their_features() -> None:
    points = frames()
    planes = ch4.fit_projections(points)
    places, exchanged = ch4.pcas(points, planes), ch4.pcas(points[:, SWAP_POINTS], planes)
    np.testing.assert_allclose(exchanged, places[:, ch4.SWAP_PCAS], rtol=0, atol=1e-12)
    assert len(ch4.SWAP_QSR) == 25
    same = np.r_[0:12, 14:25]  # the direction from one box to the other turns round
    assert np.array_equal(ch4.qsr25(exchanged)[:, same], ch4.qsr25(places)[:, ch4.SWAP_QSR][:, same])


def test_every_number_is_one_of_its_columns() -> None:
    features = ch4.qsr25(ch4.pcas(frames(), ch4.fit_projections(frames())))
    found = ch4.sparse522(features)
    assert found.shape == (30, 522) == (30, len(ch4.SPARSE_COLUMNS))
    assert (found.sum(axis=1) == 25).all()
    for row, numbers in zip(found, features, strict=True):
        said = [ch4.SPARSE_COLUMNS[k] for k in np.flatnonzero(row)]
        assert said == [f"{name}={value}" for name, value in zip(ch4.QSR_COLUMNS, numbers, strict=True)]


@pytest.mark.parametrize("n", [0, 1, 2])
def test_short_sessions_have_rows_of_zeros(n: int) -> None:
    features = ch4.qsr25(ch4.pcas(frames()[:n], ch4.fit_projections(frames())))
    assert features.shape == (n, 25)
    assert not features[:1].any()


def test_a_gap_is_told() -> None:
    points = frames()
    points[7, 5] = np.nan
    with pytest.raises(InputError, match="qualitative features") as raised:
        ch4.qsr25(ch4.pcas(points, ch4.fit_projections(frames())))
    assert "frame 7: left_hand" in raised.value.where


def test_no_plane_through_two_points() -> None:
    with pytest.raises(InputError, match="plane"):
        ch4.fit_projection(np.zeros((2, 3)))
