"""The features of chapter 5 equal what its program stored, and mean what they say."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from ecat.errors import InputError, UsageError
from learn.features import ch5

Floats = NDArray[np.float64]
QUOTIENTS = {"SlideToward": 2, "SlideAway": 1, "SlideNext": 3, "SlidePast": 2, "SlideAround": 5}
TRACKS = arrays(np.float64, (2, 12, 3), elements=st.floats(-2, 2, width=32))


# --- what was stored


@dataclass(frozen=True)
class Stored:
    action: str
    session: str
    tracks: Floats
    qualitative: pd.DataFrame
    quantitative: pd.DataFrame
    windows: dict[str, Any]


@pytest.fixture(scope="module")
def stored(shared: Path) -> list[Stored]:
    folder = shared / "demonstrations_ch5" / "demonstrations"
    if not folder.is_dir():
        pytest.skip("demonstrations_ch5 is not in the reference data")
    return list(sessions(folder))


def table(path: Path) -> dict[tuple[str, str], pd.DataFrame]:
    frame = pq.read_table(path).to_pandas()
    names = [name for name in ("action", "session", "object", "moving_object") if name in frame]
    return {
        (str(key[0]), str(key[1])): each
        for key, each in frame.astype(dict.fromkeys(names, "str")).groupby(["action", "session"])
    }


def sessions(folder: Path) -> Iterator[Stored]:
    frames, qual, quan = (
        table(folder / f"{name}.parquet") for name in ("frames_2d", "features_qual", "features_quan")
    )
    windows = json.loads((folder / "windows_summary.json").read_text("utf-8"))
    for (action, session), rows in frames.items():
        tracks = [
            ch5.subsampled(
                rows[rows.object == name].sort_values("frame")[["x", "y", "rotation"]].to_numpy(),
                QUOTIENTS[action],
            )
            for name in ("Shell", "Stella Artois")
        ]
        key = action, session
        yield Stored(
            action,
            session,
            np.stack(tracks),
            qual[key].sort_values("t"),
            quan[key].sort_values("t"),
            windows[action][session],
        )


def test_the_quotients_follow_from_the_events(shared: Path, stored: list[Stored]) -> None:
    said = json.loads((shared / "demonstrations_ch5" / "demonstrations" / "sessions.json").read_text("utf-8"))
    events: dict[str, list[tuple[int, int]]] = {}
    for one in said:
        spans = [(event["start"], event["end"]) for event in one["events"]]
        events.setdefault(one["action"], []).extend(spans)
    assert {action: ch5.quotient(spans) for action, spans in events.items()} == QUOTIENTS


def test_who_moves_equals_what_was_stored(stored: list[Stored]) -> None:
    for one in stored:
        names = np.array(["Shell", "Stella Artois"])[ch5.ranked(one.tracks)[:, 0]]
        assert names.tolist() == one.qualitative.moving_object.tolist(), (one.action, one.session)


def test_qualitative_features_equal_those_that_were_stored(stored: list[Stored]) -> None:
    compared = 0
    for one in stored:
        found = ch5.qualitative(*ch5.by_salience(one.tracks))
        said = one.qualitative[[f"f{number}" for number in range(1, 14)]].to_numpy()
        assert np.array_equal(found, said), (one.action, one.session)
        said = one.qualitative[[f"s{number}" for number in range(1, 9)]].to_numpy()
        assert np.array_equal(ch5.network_input(found, distance=True), said), (one.action, one.session)
        compared += len(found)
    assert compared == 12_829


def test_quantitative_features_equal_those_that_were_stored(stored: list[Stored]) -> None:
    for one in stored:
        found = ch5.quantitative(*ch5.by_salience(one.tracks))
        said = one.quantitative[[f"m{number}" for number in range(40)]].to_numpy()
        assert np.abs(found - said).max() < 1e-14, (one.action, one.session)


def test_windows_have_the_sums_that_were_stored(stored: list[Stored]) -> None:
    for one in stored:
        features = ch5.network_input(ch5.qualitative(*ch5.by_salience(one.tracks)))
        found = {str(scale): ch5.windows(features, scale) for scale in ch5.SCALES}
        assert {scale: len(each) for scale, each in found.items()} == one.windows["windows_per_scale"]
        assert sum(float(each.sum()) for each in found.values()) == one.windows["feat7_sum"]
        assert sum(float(np.abs(each).sum()) for each in found.values()) == one.windows["feat7_abs_sum"]
        assert found["1.5"][0].tolist() == one.windows["first_window_scale15"]


# --- what they mean


def still(x: float, y: float = 0.0, rotation: float = 0.0, n: int = 6) -> Floats:
    return np.tile(np.array([x, y, rotation]), (n, 1))


def going(start: float, step: float, n: int = 6) -> Floats:
    found = np.zeros((n, 3))
    found[:, 0] = start + step * np.arange(n)
    return found


def test_a_block_that_comes_nearer_from_the_west() -> None:
    found = ch5.qualitative(going(-0.51, 0.05), still(0.0))
    assert set(found[:, 0].tolist()) == {2}  # west
    assert found[:, 1].tolist() == [7, 7, 6, 5, 5, 4]
    assert found[0, 2:8].tolist() == [0] * 6
    assert found[1:, 4].tolist() == [-1] * 5  # towards
    assert found[1:, 5:8].any() is np.False_


def test_the_block_with_the_longer_path_is_first_and_the_other_second() -> None:
    tracks = np.stack([still(0.0, n=10), np.concatenate([still(1.0, n=5), going(1.0, 0.1, n=5)])])
    assert ch5.ranked(tracks).tolist() == [[0, 1]] * 5 + [[1, 0]] * 5  # of equals, the one that comes first


def test_of_three_blocks_the_second_is_the_farthest_or_the_nearest() -> None:
    tracks = np.stack([still(0.2), going(0.0, 0.01), still(0.9)])
    assert ch5.ranked(tracks)[0].tolist() == [1, 2]
    assert ch5.ranked(tracks, second="nearest")[0].tolist() == [1, 0]


def test_changes_that_go_around_are_one_step_the_other_way() -> None:
    features = np.zeros((5, 13), np.int16)
    features[:, 2] = [-7, 7, 6, 0, 1]
    features[:, 3] = [7, -7, 1, 2, 3]
    features[:, 10] = [-3, 3, 2, -1, 0]
    assert ch5.network_input(features)[:, 0].tolist() == [1, -1, 6, 0, 1]
    assert ch5.network_input(features)[:, -1].tolist() == [0.5, -0.5, 1, -0.5, 0]
    early = ch5.network_input(features, wrap="argd", floor=True)
    assert early[:, 0].tolist() == [-7, 7, 6, 0, 1]
    assert early[:, 1].tolist() == [-1, 1, 1, 2, 3]
    assert early[:, -1].tolist() == [0, -1, 1, -0.5, 0]  # only what went around was an integer


@given(TRACKS)
def test_corners_are_half_a_diagonal_from_the_middle_and_differences_add_up(tracks: Floats) -> None:
    first, second = tracks
    found = ch5.quantitative(first, second)
    middles = found[:, :8].reshape(-1, 4, 2).mean(axis=1)
    assert middles == pytest.approx(first[:, :2], abs=1e-12)
    away = np.linalg.norm(found[:, :8].reshape(-1, 4, 2) - first[:, None, :2], axis=2)
    assert away == pytest.approx(np.full_like(away, np.sqrt(0.5) * ch5.BLOCK_M))
    assert found[0, :8] + found[:-1, 8:16].sum(axis=0) == pytest.approx(found[-1, :8], abs=1e-12)
    assert found[:, 32:] == pytest.approx(found[:, :8] - found[:, 16:24])
    assert not found[-1, 8:16].any()


@given(TRACKS)
def test_codes_stay_in_their_ranges_and_changes_add_up(tracks: Floats) -> None:
    found = ch5.qualitative(*tracks)
    assert set(np.unique(found[:, 0])) <= set(range(9))
    assert set(np.unique(found[:, 1])) <= set(range(20))
    assert set(np.unique(found[:, 4:8])) <= {-1, 0, 1}
    for change, of in ((2, 0), (3, 1), (11, 8), (12, 9)):
        assert found[0, of] + found[:, change].cumsum().tolist()[-1] == found[-1, of]
    assert (found[:, 10] == found[:, 8] - found[:, 9]).all()


@given(TRACKS)
def test_transforms_are_both_their_difference_and_their_gradients(tracks: Floats) -> None:
    first, second = tracks
    found = ch5.transforms(first, second)
    assert found.shape == (12, len(ch5.TRANSFORM_COLUMNS))
    assert (found[:, 6:9] == first - second).all()
    assert found[0, :3] + found[:, 9:12].sum(axis=0) == pytest.approx(first[-1], abs=1e-12)


@pytest.mark.parametrize("n", [0, 1, 19, 20, 29, 30, 39, 40, 47])
def test_a_session_has_as_many_windows_as_fit(n: int) -> None:
    features = np.arange(float(n))[:, None]
    for scale in ch5.SCALES:
        found = ch5.windows(features, scale)
        assert found.shape == (max(0, n - int(20 * scale) + 1), 20, 1)
        assert not len(found) or found[-1].max() <= n - 1


def test_sub_sampling_leaves_out_what_is_over() -> None:
    assert ch5.subsampled(np.arange(11.0)[:, None], 3)[:, 0].tolist() == [0, 3, 6]
    assert ch5.quotient([]) == 1
    assert ch5.quotient([(0, 5)]) == 1


# --- gaps and bad input


def test_gaps_are_straight_lines_and_ends_are_what_is_next_to_them() -> None:
    track = np.array([[np.nan] * 3, [0, 0, 0], [np.nan] * 3, [np.nan, 1, 1], [3, 3, 0.3], [np.nan] * 3])
    found = ch5.interpolated(track)
    assert found[:, 0].tolist() == [0, 0, 1, 2, 3, 3]
    assert found[:, 2] == pytest.approx([0, 0, 0.1, 0.2, 0.3, 0.3])
    with pytest.raises(InputError, match="follow a block"):
        ch5.interpolated(np.full((4, 3), np.nan))


def test_what_is_not_known_is_refused_with_its_frame() -> None:
    track = still(0.0)
    track[4, 1] = np.nan
    for compute in (ch5.qualitative, ch5.quantitative, ch5.transforms):
        with pytest.raises(InputError) as error:
            compute(still(1.0), track)
        assert "frame 4" in error.value.where


def test_one_block_and_unknown_scales_are_refused() -> None:
    with pytest.raises(InputError, match="rank"):
        ch5.ranked(still(0.0)[None])
    with pytest.raises(UsageError, match=r"3\.0"):
        ch5.windows(np.zeros((50, 1)), 3.0)


def test_a_session_of_one_frame_has_features() -> None:
    one = still(0.5, n=1)
    assert ch5.qualitative(one, one).shape == (1, 13)
    assert ch5.quantitative(one, one).shape == (1, 40)
