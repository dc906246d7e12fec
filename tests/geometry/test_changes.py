"""What changed in a picture is seen, noise is not, and slow changes add up."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ecat.geometry.changes import (
    TILE_PX,
    Changes,
    Region,
    around,
    grown,
    marked,
    merged,
    regions,
    tile_means,
    touched,
)

WIDTH, HEIGHT = 160, 120
COORDINATES = st.integers(0, 40)
REGIONS = st.lists(
    st.builds(
        lambda x, y, w, h: (x, y, x + w, y + h),
        COORDINATES,
        COORDINATES,
        st.integers(1, 9),
        st.integers(1, 9),
    ),
    max_size=8,
)


def test_tiles_are_means_and_an_incomplete_rim_is_cut_off() -> None:
    grey = np.repeat(np.arange(3, dtype=np.uint8) * 50, TILE_PX)[None].repeat(2 * TILE_PX + 3, 0)
    assert tile_means(np.pad(grey, ((0, 0), (0, 5)))).tolist() == [[0, 50, 100]] * 2
    assert tile_means(np.zeros((3, 100), np.uint8)).size == 0
    noise = np.random.default_rng(1).integers(0, 256, (50, 70), dtype=np.uint8)
    some = noise[:48:4, :64].reshape(6, 2, 8, 8).mean((1, 3))
    assert (tile_means(noise) == np.floor(some)).all()
    assert (tile_means(np.full((16, 24), 255, np.uint8)) == 255).all()


def test_noise_is_no_change_and_a_patch_is_where_it_is() -> None:
    rng = np.random.default_rng(0)
    changes = Changes(8)

    def look(patch: bool) -> list[Region]:
        grey = rng.normal(120, 3, (HEIGHT, WIDTH))
        if patch:
            grey[40:60, 80:100] += 60
        return regions(changes.look(tile_means(np.clip(grey, 0, 255).astype(np.uint8))))

    assert look(patch=False) == [(0, 0, WIDTH, HEIGHT)]  # never looked at before
    assert [look(patch=False) for _ in range(30)] == [[]] * 30
    ((left, top, right, bottom),) = look(patch=True)
    assert left <= 80
    assert 100 <= right <= 80 + 20 + 3 * TILE_PX
    assert top <= 40
    assert 60 <= bottom <= 40 + 20 + 3 * TILE_PX
    assert look(patch=True) == []  # looked at


def test_slow_changes_count_once_they_have_added_up() -> None:
    changes = Changes(5)
    seen = [changes.look(np.full((10, 10), 100 + i, np.uint8)) for i in range(11)]
    assert [i for i, changed in enumerate(seen) if changed.all()] == [0, 5, 10]
    assert sum(int(changed.any()) for changed in seen) == 3


def test_distant_changes_are_separate_regions() -> None:
    changes = Changes(5)
    tiles = np.full((30, 30), 100, np.uint8)
    assert changes.all_seen(tiles).all()
    tiles[2, 3] = tiles[25, 20] = 0
    assert len(regions(changes.look(tiles))) == 2
    assert regions(changes.look(tiles)) == []


def test_rings_are_told_by_whether_something_changed_there() -> None:
    changed = np.zeros((10, 12), np.uint8)
    changed[3, 4] = changed[9, 11] = 1
    square = np.array([[0.0, 0], [9, 0], [9, 9], [0, 9]])
    corners = ([32, 24], [24, 16], [41, 24], [32, 8], [97, 85], [-30, -30], [200, 200])
    rings = np.stack([square + corner for corner in np.array(corners, float)])
    # what is beyond the last tile belongs to it
    assert touched(changed, rings).tolist() == [True, True, False, False, True, False, True]
    among = np.array([False, True, True, False, False, False, False])
    assert touched(changed, rings, among).tolist() == [False, True] + [False] * 5
    assert touched(np.zeros((0, 0), np.uint8), rings).tolist() == [False] * 7


def test_regions_can_be_looked_at_whether_they_changed_or_not() -> None:
    changed = np.zeros((10, 12), np.uint8)
    more = marked(changed, [(9, 16, 17, 24), (80, 70, 200, 90)])
    assert not changed.any()
    assert np.argwhere(more).tolist() == [[2, 1], [2, 2], [8, 10], [8, 11], [9, 10], [9, 11]]


def test_regions_grow_up_to_the_image() -> None:
    assert grown((10, 10, 20, 20), 4.2, (100, 23)) == (5, 5, 23, 25)
    assert grown((1, 2, 3, 4), 10, (50, 60)) == (0, 0, 13, 14)


def test_what_moved_is_looked_for_further_away() -> None:
    ring = np.array([[40.0, 40], [60, 40], [60, 60], [40, 60]])
    still, moving = (around(ring, np.full((4, 2), way), (100, 100)) for way in (0.0, -5.0))
    assert still == (22, 22, 79, 79)
    assert moving == (7, 7, 94, 94)


@given(REGIONS)
def test_merged_regions_cover_the_same_and_do_not_overlap(parts: list[Region]) -> None:
    found = merged(parts)
    covered = np.zeros((60, 60), int)
    for left, top, right, bottom in found:
        covered[top:bottom, left:right] += 1
    assert covered.max(initial=0) <= 1
    assert all(covered[t:b, x:r].all() for x, t, r, b in parts)
