"""Sessions that say when to stop; and other scenes for training, which differ in what does not matter alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from ecat.progress import silent
from learn.features.raw import DEPTH, HEIGHT, MIRROR_CHANNELS, MIRROR_SIGNS, N_CHANNELS, PLANE, SHAPE
from learn.recognize.dataset import LabelledSession, places_of, read_exports, vocabulary_of
from learn.recognize.folds import Key
from learn.recognize.inputs import Fitted
from learn.recognize.neural.examples import Augment, dense, held_out, stretched
from learn.recognize.neural.recognizer import FEATURES, RECIPES
from learn.recognize.neural.training import Settings
from tests.learn.recognize import made

MANY = 400


@pytest.fixture(autouse=True)
def _seeded() -> Iterator[None]:
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        yield


@pytest.fixture
def windows() -> torch.Tensor:
    """One window, many times; a random walk."""
    steps = torch.randn(1, 20, N_CHANNELS) / 50
    return (torch.randn(1, 1, N_CHANNELS) / 3 + steps.cumsum(1)).expand(MANY, -1, -1)


def short_of(session: LabelledSession) -> LabelledSession:
    """The first window of a session."""
    return replace(session, points=session.points[:20], labels=session.labels[:1])


def still() -> Augment:
    """Without anything that is off at random: mirrors and sides are left."""
    found = Augment()
    for name, value in vars(Augment).items():
        if isinstance(value, float):
            setattr(found, name, 0.0)
    return found


def apart(windows: torch.Tensor) -> torch.Tensor:
    """Distances between all points of each frame."""
    places = windows[..., PLANE].unflatten(2, (-1, 2))
    return torch.cdist(places, places, compute_mode="donot_use_mm_for_euclid_dist")


@pytest.mark.parametrize(("n", "held"), [(4, 0), (5, 1), (10, 1)])
def test_where_a_share_of_no_file_is_a_session_one_of_all_is_held_out_that_the_seed_draws(
    n: int, held: int, tmp_path: Path
) -> None:
    sessions = read_exports(made.exports(tmp_path))[:n]
    apart = [replace(one, file=str(number)) for number, one in enumerate(sessions)]
    drawn: list[list[Key]] = []
    for seed in [*range(8), *range(8)]:
        known, aside = held_out(apart, Settings("mlp", seed=seed, validation=0.1))
        drawn.append([one.key for one in aside])
        assert [one.key for one in apart if one.key not in drawn[-1]] == [one.key for one in known]
    assert {len(keys) for keys in drawn} == {held}
    assert drawn[:8] == drawn[8:]
    assert len({str(keys) for keys in drawn}) > held
    assert held_out(apart, Settings("mlp", validation=0))[1] == []


def test_windows_are_left_as_they_were(windows: torch.Tensor) -> None:
    before = windows.clone()
    assert Augment()(windows).shape == windows.shape
    torch.testing.assert_close(windows, before, rtol=0, atol=0)


def test_the_same_seed_gives_the_same_scenes(windows: torch.Tensor) -> None:
    found: list[torch.Tensor] = []
    for _ in range(2):
        torch.manual_seed(3)
        found.append(Augment()(windows))
    torch.testing.assert_close(found[0], found[1], rtol=0, atol=0)
    assert not torch.equal(found[0][0], found[0][1])


def test_mirrors_and_sides_keep_distances_or_mirror_them(windows: torch.Tensor) -> None:
    found = apart(still()(windows))
    same, mirrored = apart(windows[:1]), apart(windows[:1, :, MIRROR_CHANNELS])
    off = torch.stack([(found - one).abs().amax((1, 2, 3)) for one in (same, mirrored)])
    assert float(off.amin(0).max()) < 1e-4
    share = float((off[1] < off[0]).float().mean())
    assert 0.4 < share < 0.6


def test_scenes_are_seen_from_every_side(windows: torch.Tensor) -> None:
    found = still()(windows)[:, 0, :2]
    angles = torch.atan2(found[:, 1], found[:, 0])
    counts = torch.histc(angles, 8, -torch.pi, torch.pi)
    assert float(counts.min()) > MANY / 16


def test_what_is_no_place_is_not_turned(windows: torch.Tensor) -> None:
    rest = torch.cat([windows[..., part] for part in (SHAPE, HEIGHT, DEPTH)], dim=2)
    mirror = (windows[..., MIRROR_CHANNELS] * torch.from_numpy(MIRROR_SIGNS))[..., PLANE.stop :]
    found = still()(windows)[..., PLANE.stop :]
    off = torch.stack([(found - one).abs().amax((1, 2)) for one in (rest, mirror)])
    assert float(off.amin(0).max()) < 1e-6


def test_what_is_off_is_off_throughout_the_window(windows: torch.Tensor) -> None:
    still_there = windows[:, :1].expand(-1, 20, -1)
    found = Augment()(still_there)
    within, between = found.std(1).mean(), found[..., HEIGHT].std(0).mean()
    assert float(within) < 0.005
    assert float(between) > 0.02


def test_the_corners_of_a_box_stay_together(windows: torch.Tensor) -> None:
    augment = still()
    augment.box_m = 0.1
    found = apart(augment(windows[..., :]))[..., 13:17, 13:17]
    one, other = (
        apart(windows[:1])[..., 13:17, 13:17],
        apart(windows[:1, :, MIRROR_CHANNELS])[..., 13:17, 13:17],
    )
    assert (
        float(torch.minimum((found - one).abs().amax((1, 2, 3)), (found - other).abs().amax((1, 2, 3))).max())
        < 1e-4
    )


def test_a_session_that_takes_longer_goes_the_same_way_more_slowly() -> None:
    points = np.arange(30.0)[:, None, None] * np.arange(1.0, 4.0) + np.arange(1.0, 22.0)[:, None]
    np.testing.assert_array_equal(stretched(points, 1.0), points)
    slower, faster = stretched(points, 1.25), stretched(points, 0.5)
    assert (len(slower), len(faster)) == (37, 15)
    np.testing.assert_allclose(np.diff(slower, axis=0), np.tile([0.8, 1.6, 2.4], (36, 21, 1)))
    np.testing.assert_allclose(np.diff(faster, axis=0), np.tile([2.0, 4.0, 6.0], (14, 21, 1)))


@pytest.mark.parametrize("unknown", [np.nan, -1.0, 0.1])
def test_where_a_point_was_not_seen_nothing_is_between(unknown: float) -> None:
    points = np.arange(30.0)[:, None, None] / 30 + np.ones((30, 21, 3))
    points[10:15, 13:17] = unknown  # 0.1: four corners in one place
    found = stretched(points, 1.2)[:, 13:17]
    lost = np.isin(found, unknown) | np.isnan(found)
    assert 5 <= lost.all(axis=(1, 2)).sum() <= 7
    assert (lost.all(axis=(1, 2)) == lost.any(axis=(1, 2))).all()
    assert found[~lost].min() >= 1


def test_a_network_learns_from_sessions_at_three_speeds_with_labels_at_the_same_moments(
    tmp_path: Path,
) -> None:
    sessions = read_exports(made.exports(tmp_path))[:4]
    labels = vocabulary_of(sessions)
    fitted = Fitted.of(FEATURES["neural"], [one.points for one in sessions])
    one = max(sessions, key=lambda session: len(session.labels))
    inputs, targets = dense([one], fitted, labels, RECIPES["neural"], silent)
    durations = RECIPES["neural"].durations
    counts = [len(fitted.windows(stretched(one.points, times), 1)) for times in durations]
    assert len(inputs) == len(targets) == sum(counts)
    own = targets[counts[0] : counts[0] + counts[1]]
    assert own[::5].argmax(1).tolist() == places_of(one.labels, labels)
    assert own.sum(1).allclose(torch.ones(len(own)))
    for times, part in zip(durations, targets.split(counts), strict=True):
        changed = [
            int((one_by_one.argmax(1) != one_by_one[0].argmax()).int().argmax()) for one_by_one in (own, part)
        ]
        middles = changed[0] + 10, (changed[1] + 10) / times
        assert middles[0] == pytest.approx(middles[1], abs=2)


def test_a_session_that_is_too_short_at_another_speed_is_learned_at_its_own(tmp_path: Path) -> None:
    sessions = read_exports(made.exports(tmp_path))
    short = short_of(sessions[0])
    fitted = Fitted.of(FEATURES["neural"], [one.points for one in sessions])
    inputs, _ = dense([short], fitted, vocabulary_of(sessions), RECIPES["neural"], silent)
    assert len(inputs) == 2  # as it is, and slower
