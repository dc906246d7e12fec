"""A session of many actions is cut into one recording of each movement."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ecat.errors import InputError
from ecat.geometry.transforms import Rigid
from learn.features.windows import windows_of
from learn.recognize.episodes import episodes
from learn.recognize.predict import recognize
from tests.learn.recognize import made
from tests.learn.recognize.told import Says, long, recording


def test_a_short_session_is_one_episode() -> None:
    (one,) = episodes(recording(made.scene(1)))
    assert one.points == pytest.approx(made.scene(1))
    assert one.frame.tolist() == list(range(made.N_FRAMES + 1))


def test_a_long_session_is_cut_into_its_movements_with_a_margin() -> None:
    found = episodes(recording(long((100, 140), (300, 350))))
    assert len(found) == 2
    for one, (start, end) in zip(found, ((100, 140), (300, 350)), strict=True):
        assert one.frame[0] == pytest.approx(start - 10, abs=6)
        assert one.frame[-1] == pytest.approx(end + 10, abs=6)
        assert len(one.frame) == len(one.points) + 1


def test_movements_with_a_short_pause_are_one() -> None:
    assert len(episodes(recording(long((100, 140), (150, 190))))) == 1


def test_where_nothing_moves_nothing_is_recognised() -> None:
    assert recognize(recording(long()), Says([1])) == []


def test_places_of_poses_count_more_than_those_of_markers() -> None:
    tracks = np.zeros((2, 600, 3))
    tracks[1, :, 0] = 0.3 * np.clip((np.arange(600) - 400) / 40, 0, 1)
    (one,) = episodes(replace(recording(long((100, 140))), tracks=tracks))
    assert one.frame[0] == pytest.approx(390, abs=6)


def test_movements_that_the_session_knows_are_taken_and_those_of_both_boxes_at_once_are_one() -> None:
    moves = ((100, 140), (120, 150), (150, 190), (400, 430), (640, 700))
    found = episodes(replace(recording(long((300, 340))), moves=moves))
    assert [(one.frame[0], one.frame[-1]) for one in found] == [(90, 160), (140, 200), (390, 440)]
    assert episodes(replace(recording(long((300, 340))), moves=())) == []


@pytest.mark.parametrize(("fps", "n"), [(60.0, 200), (15.0, 50), (10.0, 40)])
def test_other_rates_become_the_usual_one_and_spans_are_frames_of_the_session(fps: float, n: int) -> None:
    says = Says([1])
    (one,) = recognize(recording(made.scene(1, n_frames=n), fps), says)
    assert len(says.seen[0]) == pytest.approx(n * 30 / fps, abs=3)
    assert 0 < one.start < one.end < n
    assert (one.end - one.start) / fps == pytest.approx((len(says.seen[0]) - 17.5) / 30, abs=6 / 30)
    x = made.scene(1, n_frames=n)[:, 13, 0]
    assert says.seen[0][:, 13, 0].min() == pytest.approx(x.min(), abs=1e-6)
    assert says.seen[0][:, 13, 0].max() == pytest.approx(x.max(), abs=0.02)


@pytest.mark.parametrize("fps", [24.0, 30.0, None])
def test_usual_rates_and_unknown_ones_stay_as_they_are(fps: float | None) -> None:
    says = Says([1])
    recognize(recording(made.scene(1), fps), says)
    assert (says.seen[0] == made.scene(1)).all()


@pytest.mark.parametrize("unseen", [16, 24])
def test_gaps_are_not_filled_by_resampling(unseen: int) -> None:
    points = made.scene(1, n_frames=90)
    points[30 : 30 + unseen, 13:17] = np.nan
    one = episodes(recording(points, 60.0))[0]
    assert np.isnan(one.points[18:21, 13]).all()
    assert np.isfinite(one.points[18:21, 17]).all()


def test_windows_that_hardly_show_a_box_are_left_out_and_that_is_said() -> None:
    """Box 1 goes on where it is not seen, and so it seems to have moved all the time."""
    points, says, findings = long((100, 140), (300, 700), (800, 840), n=1000), Says([1]), list[str]()
    points[280:720, 13:17] = np.nan
    found = recognize(recording(points), says, findings=findings)
    assert [(one.start < 295, one.end > 705) for one in found] == [(True, False), (False, True)]
    assert all(one.end <= 295 or one.start >= 705 for one in found)
    (said,) = findings
    assert "left out 13.7 s (frames 295 to 705)" in said
    assert "o1 is not seen for 13.7 s" in said
    assert "o2" not in said


@given(st.data())
def test_every_window_shows_both_boxes_a_quarter_of_the_time_at_least(data: st.DataObject) -> None:
    n = data.draw(st.integers(20, 300))
    points = made.scene(1, n_frames=n)
    for at in (13, 17):
        for _ in range(data.draw(st.integers(0, 3))):
            start = data.draw(st.integers(0, n))
            points[start : start + data.draw(st.integers(0, 60)), at : at + 4] = np.nan
    findings: list[str] = []
    found = episodes(replace(recording(points), moves=((0, n),)), findings)
    for one in found:
        windows = np.isfinite(windows_of(one.points)[:, :, [13, 17]]).all(axis=3).mean(axis=1)
        assert (windows >= 0.25).all()
    seen = np.isfinite(points[:, [13, 17], 0])
    if not findings:
        assert n + 1 - len({frame for one in found for frame in one.frame.tolist()}) <= 20
    if seen.all():
        assert findings == []
    assert bool(found) or not seen.all()


def test_a_box_that_is_seen_every_other_frame_is_seen() -> None:
    points, findings = made.scene(1), list[str]()
    points[::2, 13:17] = np.nan
    assert len(episodes(recording(points), findings)) == 1
    assert findings == []


@pytest.mark.parametrize("fps", [30.0, 60.0])
def test_no_window_goes_over_a_jump_of_the_clock(fps: float) -> None:
    points, findings = long((80, 160), n=240), list[str]()
    t_s = np.arange(240) / fps + np.where(np.arange(240) < 120, 0.0, 45.0)
    found = recognize(replace(recording(points), t_s=t_s), Says([1]), findings=findings)
    assert found
    assert all(one.end <= 120 or one.start >= 120 for one in found)
    assert findings == [
        "the clock jumps 1 time, by 45.0 s in all, first at frame 120: what is before and after is recognised apart"
    ]


def test_one_frame_of_another_age_does_not_count() -> None:
    t_s = np.arange(made.N_FRAMES) / 60
    t_s[-1] = 1e9
    (one,) = episodes(replace(recording(made.scene(1)), t_s=t_s, moves=((0, made.N_FRAMES),)))
    assert one.frame[-1] <= made.N_FRAMES - 1


def test_a_session_that_jumps_all_the_time_is_refused() -> None:
    t_s = np.arange(made.N_FRAMES) / 30 + 10 * (np.arange(made.N_FRAMES) // 15)
    with pytest.raises(InputError) as error:
        episodes(replace(recording(made.scene(1)), t_s=t_s))
    assert "at most 15 follow each other with one table and no jump of the clock" in error.value.where


def test_a_moved_camera_parts_what_is_recognised() -> None:
    planes = ((0, Rigid.identity()), (300, Rigid.identity()))
    moved = replace(recording(long((280, 320))), planes=planes)
    found = episodes(moved)
    assert [one.frame[-1] <= 300 or one.frame[0] >= 300 for one in found] == [True] * len(found)
    says = Says([1])
    recognize(moved, says)
    assert says.tables == [one.table for one in found if one.table is not None]


def test_the_table_of_the_session_is_told_where_it_is_known() -> None:
    below = Rigid(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), np.zeros(3))
    says = Says([1])
    recognize(replace(recording(made.scene(1)), planes=((0, below),)), says)
    assert [table.slope for table in says.tables] == [0.0]
    recognize(recording(made.scene(1)), says)
    assert len(says.tables) == 1


def test_a_session_shorter_than_a_window_is_refused_with_its_length() -> None:
    for n in (0, 1, 19):
        with pytest.raises(InputError) as error:
            recognize(recording(made.scene(1)[:n]), Says([1]))
        assert f"{n} frames" in error.value.where


def test_a_session_of_too_few_frames_per_second_is_refused() -> None:
    with pytest.raises(InputError) as error:
        episodes(recording(made.scene(1), 5.0))
    assert "5.0 frames per second" in error.value.where


def test_a_session_that_is_too_short_at_the_usual_rate_is_refused_with_its_length_at_that() -> None:
    with pytest.raises(InputError) as error:
        episodes(recording(made.scene(1, n_frames=180), 10_000.0))
    assert "it has 180 frames, a window 20" in error.value.where
    assert "from 0 to 0.0179 s, they are 1 at 30 per second" in error.value.where


def test_movements_at_the_ends_of_a_session_have_as_many_frames_as_a_window() -> None:
    found = episodes(replace(recording(long(n=400)), moves=((0, 8), (200, 230), (393, 400))))
    assert [(one.frame[0], one.frame[-1]) for one in found] == [(0, 20), (190, 240), (380, 400)]


@given(st.integers(151, 400), st.data())
def test_no_movement_is_left_out(n: int, data: st.DataObject) -> None:
    start = data.draw(st.integers(0, n - 1))
    end = data.draw(st.integers(start + 1, n))
    (one,) = episodes(replace(recording(np.zeros((n, 21, 3))), moves=((start, end),)))
    assert one.frame[0] <= start
    assert one.frame[-1] >= end
    assert len(one.points) >= 20


def test_of_a_box_that_was_never_seen_nothing_is_said() -> None:
    points, findings = long((100, 140)), list[str]()
    points[:, 17:] = np.nan
    points[:, :13] = np.nan
    assert episodes(recording(points), findings) == []
    assert "o2 is not seen for 20.0 s" in findings[0]
