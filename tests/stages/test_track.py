"""Faces in a video: found, followed, found again, and turned into the table that the next stages read."""

from __future__ import annotations

import weakref
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from ecat.geometry.boxes import box_corners, match_codes
from ecat.geometry.boxfit import Noise
from ecat.geometry.cameras import KINECT_V2_COLOR, KINECT_V2_DEPTH, Camera
from ecat.geometry.detection import Detector, Evidence, Found
from ecat.geometry.transforms import Floats, Rigid, matrix_from_rotvec
from ecat.model.prototype import PEPSI, SHELL, STELLA_ARTOIS
from ecat.stages.sightings import box_sightings, read_faces
from ecat.stages.track import object_ids, track_markers
from ecat.stages.tracker import Tracker, TrackParameters
from ecat.tables import MARKERS_2D
from tests.geometry.printed import exposed, paint, wall

CAMERA = replace(
    KINECT_V2_COLOR, width=480, height=360, fx=500.0, fy=500.0, cx=240.0, cy=180.0, mirrored=False
)
BOXES = (SHELL, STELLA_ARTOIS)
PARAMETERS = TrackParameters(prototypes=BOXES)


@dataclass
class Film:
    """A video in memory."""

    images: Sequence[NDArray[Any]]
    camera: Camera | None = None
    t_ns: NDArray[np.int64] | None = None
    unit_m: float = 0.001
    frame: NDArray[np.int64] = field(init=False)

    def __post_init__(self) -> None:
        self.frame = np.arange(len(self.images))

    def __len__(self) -> int:
        return len(self.images)

    def __iter__(self) -> Iterator[NDArray[Any]]:
        return iter(self.images)

    def read(self, indices: Sequence[int]) -> Iterator[NDArray[Any]]:
        return (self.images[i] for i in indices)


def pose_at(x: float, turn: float, distance: float = 1.2) -> Rigid:
    """camera-from-box: seen from above one edge, so that its top and two sides are in view."""
    lean = matrix_from_rotvec(np.array([2.3, 0.0, 0.0])) @ matrix_from_rotvec(np.array([0.0, 0.0, turn]))
    return Rigid(lean, np.array([x, 0.0, distance]))


def rings_of(pose: Rigid, camera: Camera = CAMERA) -> dict[int, Floats]:
    """Corners (4, 2) of the faces of SHELL that the camera sees well, by face index, in the print's order."""
    moved = camera.from_reference.inverse() @ pose
    corners = moved.apply(box_corners(SHELL))
    pixels = camera.project(corners)
    normal = np.cross(corners[:, 3] - corners[:, 0], corners[:, 1] - corners[:, 0])
    away = (
        (normal * corners.mean(1)).sum(1)
        / np.linalg.norm(normal, axis=1)
        / np.linalg.norm(corners.mean(1), axis=1)
    )
    return {f: pixels[f] for f in range(len(pixels)) if away[f] < -0.45}


def image_of(
    rng: np.random.Generator, pose: Rigid | None, camera: Camera = CAMERA, hidden: tuple[int, ...] = ()
) -> NDArray[np.uint8]:
    image = wall(np.random.default_rng(0), (camera.height, camera.width))
    for face, ring in ({} if pose is None else rings_of(pose, camera)).items():
        code = SHELL.faces[face].code
        if face not in hidden:
            # a mirrored camera shows the print from its back: the code follows the corners
            paint(image, code, ring)
    return exposed(image, rng, blur_px=0.6)


@cache
def film(n: int) -> list[NDArray[np.uint8]]:
    """The box stands, moves away with growing speed, turns, and is hidden for a while."""
    rng = np.random.default_rng(9)
    images: list[NDArray[np.uint8]] = []
    for i in range(n):
        moved = 0.0 if i < 8 else min(0.0006 * (i - 8) ** 2, 0.35)
        pose = pose_at(-0.25 + moved, 2.3 + 0.02 * max(i - 20, 0))
        hidden = (0,) if 13 <= i < 17 else ((0, 1, 2) if 24 <= i < 27 else ())
        images.append(image_of(rng, pose, hidden=hidden))
    return images


def faces_of(found: Sequence[Found]) -> set[tuple[int, int, int]]:
    return {
        (i, b, f) for i, x in enumerate(found) for b, f in zip(x.box.tolist(), x.face.tolist(), strict=True)
    }


def test_following_finds_what_searching_every_image_finds() -> None:
    images = film(45)
    detector = Detector(BOXES, CAMERA)
    searched = [detector.search(image) for image in images]
    tracker = Tracker(detector, PARAMETERS)
    followed = list(tracker.follow(images))
    assert faces_of(followed) == faces_of(searched)
    assert len(faces_of(searched)) > 70
    for a, b in zip(followed, searched, strict=True):
        order = [np.lexsort((x.face, x.box)) for x in (a, b)]
        assert np.abs(a.rings[order[0]] - b.rings[order[1]]).max(initial=0) < 0.15


@pytest.mark.parametrize("width", [11, 12, 13, 14])
def test_a_face_seen_from_the_side_is_found_as_a_search_finds_it(width: int) -> None:
    """Its far edge, and the edges of its cells, are only a few pixels from the near one."""
    image = wall(np.random.default_rng(0), (360, 480))
    ring = np.array([[240.0, 150], [240 + width, 158], [240 + width, 218], [240, 210]])
    paint(image, SHELL.faces[0].code, ring)
    images = [exposed(image, np.random.default_rng(i), blur_px=0.5) for i in range(1, 8)]
    detector = Detector(BOXES)
    searched = [detector.search(grey) for grey in images]
    assert len(searched[0]) == 1
    assert faces_of(searched) <= faces_of(list(Tracker(detector, PARAMETERS).follow(images)))


def test_the_image_is_searched_in_full_only_now_and_then(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(2)
    detector = Detector(BOXES, CAMERA)
    regions: list[object] = []
    candidates = detector.candidates

    def counted(grey: NDArray[np.uint8], region: tuple[int, int, int, int] | None = None) -> Floats:
        regions.append(region)
        return candidates(grey, region)

    monkeypatch.setattr(detector, "candidates", counted)
    tracker = Tracker(detector, TrackParameters(prototypes=BOXES, every=10))
    images = (image_of(rng, pose_at(0.0, 2.3)) for _ in range(20))
    assert [len(found) for found in tracker.follow(images)] == [3] * 20
    assert regions == [(0, 0, 480, 360)] * 2  # nothing moves: nothing is searched in between


def test_faces_that_were_followed_are_not_read_again_from_roughly_placed_candidates(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng = np.random.default_rng(2)
    detector = Detector(BOXES, CAMERA)
    candidates, read = detector.candidates, detector.read
    given: list[int] = []

    def rough(grey: NDArray[np.uint8], region: tuple[int, int, int, int] | None = None) -> Floats:
        rings = candidates(grey, region)
        return rings + 3.0 if given else rings

    def counted(grey: NDArray[np.uint8], rings: Floats) -> Found:
        given.append(len(rings))
        return read(grey, rings)

    monkeypatch.setattr(detector, "candidates", rough)
    monkeypatch.setattr(detector, "read", counted)
    tracker = Tracker(detector, TrackParameters(prototypes=BOXES, every=1))
    images = (image_of(rng, pose_at(0.0, 2.3)) for _ in range(4))
    assert [len(found) for found in tracker.follow(images)] == [3] * 4
    assert given[0] >= 3
    assert given[1:] == [0] * 3


def test_a_box_put_into_view_is_found_in_the_same_image() -> None:
    rng = np.random.default_rng(3)
    tracker = Tracker(Detector(BOXES, CAMERA), TrackParameters(prototypes=BOXES, every=1000))
    found = [
        len(f) for f in tracker.follow(image_of(rng, pose_at(0.1, 2.3) if i > 2 else None) for i in range(9))
    ]
    assert found[:3] == [0] * 3
    assert min(found[3:]) >= 2


def test_a_face_that_shows_for_one_image_while_an_arm_passes_is_found_there() -> None:
    rng = np.random.default_rng(14)
    sleeve = np.repeat(rng.integers(40, 160, 60), 8).astype(np.uint8)
    images: list[NDArray[np.uint8]] = []
    for i in range(26):
        grey = image_of(rng, pose_at(0.0, 2.3))
        if i > 4 and i != 13:
            grey[:, 20 + 8 * i : 220 + 8 * i] = np.roll(sleeve, 5 * i)[:200]
        images.append(grey)
    detector = Detector(BOXES, CAMERA)
    searched = faces_of([detector.search(image) for image in images])
    assert {i for i, _, _ in searched} >= {0, 4, 13}
    assert not {i for i, _, _ in searched} & {11, 12, 14, 15}
    tracker = Tracker(detector, TrackParameters(prototypes=BOXES, every=1000))
    assert faces_of(list(tracker.follow(images))) >= searched


def test_a_face_that_gets_clear_by_and_by_is_found_though_no_tile_changes() -> None:
    rng = np.random.default_rng(16)
    ring = np.array([[200.0, 150], [224, 152], [222, 176], [199, 174]])
    images: list[NDArray[np.uint8]] = []
    for i in range(24):
        image = wall(np.random.default_rng(0), (360, 480))
        paint(image, SHELL.faces[0].code, ring)
        images.append(exposed(image, rng, blur_px=1.2, noise=26.0 if i < 10 else 2.0))
    detector = Detector(BOXES)
    assert not len(detector.search(images[0]))
    searched = faces_of([detector.search(image) for image in images])
    parameters = TrackParameters(prototypes=BOXES, every=1000, changed=255)
    followed = faces_of(list(Tracker(detector, parameters).follow(images)))
    assert followed >= searched >= {(i, 0, 0) for i in range(10, 24)}


def test_a_box_that_is_turned_while_out_of_sight_shows_another_face_at_the_same_place() -> None:
    rng = np.random.default_rng(15)
    ring = np.array([[200.0, 150], [260, 154], [256, 214], [198, 210]])
    images: list[NDArray[np.uint8]] = []
    for face in [0] * 5 + [None] * 5 + [1] * 5:
        image = wall(np.random.default_rng(0), (360, 480))
        if face is not None:
            paint(image, SHELL.faces[face].code, ring)
        images.append(exposed(image, rng))
    found = list(Tracker(Detector(BOXES), TrackParameters(prototypes=BOXES, every=1000)).follow(images))
    assert [f.face.tolist() for f in found] == [[0]] * 5 + [[]] * 5 + [[1]] * 5


def test_a_box_that_appears_while_it_moves_is_followed_back_to_its_first_image() -> None:
    rng = np.random.default_rng(13)
    # 12 pixels per image, from the second image that is searched only for changes
    images = [image_of(rng, pose_at(-0.2 + 0.028 * i, 2.3) if i > 2 else None) for i in range(12)]
    detector = Detector(BOXES, CAMERA)
    tracker = Tracker(detector, TrackParameters(prototypes=BOXES, every=1000))
    assert faces_of(list(tracker.follow(images))) == faces_of([detector.search(image) for image in images])


@pytest.mark.parametrize("together", [0, 1, 2, 4])
def test_how_many_images_are_taken_together_makes_no_difference(together: int) -> None:
    images = film(45)
    some = [
        list(Tracker(Detector(BOXES, CAMERA), replace(PARAMETERS, together=n)).follow(images))
        for n in (together, PARAMETERS.together)
    ]
    assert [len(found) for found in some] == [45, 45]
    assert faces_of(some[0]) == faces_of(some[1])


def test_the_table_is_like_an_imported_one_and_places_the_corners() -> None:
    rng = np.random.default_rng(4)
    pose = pose_at(0.0, 2.3)
    t_ns = np.arange(6) * 33_000_000
    table = track_markers(Film([image_of(rng, pose) for _ in range(6)], CAMERA, t_ns), PARAMETERS)
    assert table.schema == MARKERS_2D.arrow
    keys = list(zip(*(table[name].to_pylist() for name in MARKERS_2D.order), strict=True))
    assert keys == sorted(set(keys))
    assert set(table["object_id"].to_pylist()) == {"shell"}
    assert (table["t_ns"].to_numpy() == 33_000_000 * table["frame"].to_numpy()).all()
    numbers = np.array([table[name].to_numpy() for name in MARKERS_2D.arrow.names[-8:]]).T.reshape(-1, 4, 2)
    assert (numbers.sum(-1).argmin(1) == 0).all()
    x, y = numbers[..., 0], numbers[..., 1]
    area = (x * np.roll(y, -1, 1) - np.roll(x, -1, 1) * y).sum(1)
    assert (area > 0).all()  # clockwise on the screen
    order = table["order"].to_numpy()
    assert all(a > b for a, b, k in zip(area, area[1:], order[1:], strict=False) if k)


@pytest.mark.parametrize("mirrored", [False, True])
def test_the_next_stages_get_every_corner_where_the_print_has_it(*, mirrored: bool) -> None:
    camera = replace(CAMERA, mirrored=mirrored)
    rng = np.random.default_rng(5)
    pose = pose_at(0.05, 2.3)
    table = track_markers(Film([image_of(rng, pose, camera) for _ in range(6)], camera), PARAMETERS)
    faces = read_faces(table, None, camera)
    assert set(match_codes(faces.code, BOXES, mirrored=mirrored)) == set(faces.code)
    (box,) = box_sightings(faces, BOXES, camera, Noise())
    truth = rings_of(pose, camera)
    assert len(truth) >= 2
    for face, ring in truth.items():
        assert np.abs(box.seen.pixels[:, face] - ring).max() < 0.4


def test_grey_and_colour_images_give_the_same() -> None:
    rng = np.random.default_rng(6)
    images = [image_of(rng, pose_at(0.0, 2.3)) for _ in range(5)]
    coloured = [np.repeat(image[..., None], 3, 2) for image in images]
    assert track_markers(Film(images, CAMERA), PARAMETERS) == track_markers(
        Film(coloured, CAMERA), PARAMETERS
    )


def test_rows_do_not_depend_on_how_many_images_are_put_together(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(6)
    film = Film([image_of(rng, pose_at(0.0, 2.3)) for _ in range(8)], CAMERA)
    whole = track_markers(film, PARAMETERS)
    monkeypatch.setattr("ecat.stages.track._AT_ONCE", 3)
    assert track_markers(film, PARAMETERS).to_pylist() == whole.to_pylist()


def test_a_box_seen_too_seldom_is_no_object() -> None:
    rng = np.random.default_rng(7)
    images = [image_of(rng, pose_at(0.0, 2.3) if i < 4 else None) for i in range(8)]
    assert track_markers(Film(images, CAMERA), PARAMETERS).num_rows == 0
    assert track_markers(Film(images, CAMERA), replace(PARAMETERS, sightings=4)).num_rows > 0
    # a recording of three images cannot show it five times
    assert track_markers(Film(images[:3], CAMERA), PARAMETERS).num_rows > 0


def test_depth_that_contradicts_the_size_of_a_face_disproves_it() -> None:
    rng = np.random.default_rng(8)
    camera = replace(CAMERA, from_reference=KINECT_V2_COLOR.from_reference)
    images = [image_of(rng, pose_at(0.0, 2.3), camera) for _ in range(6)]

    def rows(depth_mm: int) -> int:
        depth = Film([np.full((424, 512), depth_mm, np.uint16)] * 6, KINECT_V2_DEPTH)
        return track_markers(Film(images, camera), PARAMETERS, depth).num_rows

    assert rows(1200) > 0
    assert rows(0) > 0  # nothing was measured there
    assert rows(600) == 0


def test_what_no_square_can_look_like_is_no_marker() -> None:
    image = wall(np.random.default_rng(0), (360, 480))
    # a rhombus with perspective that no camera of this focal length gives
    ring = np.array([[180.0, 120], [300, 120], [262, 240], [218, 240]])
    paint(image, SHELL.faces[0].code, ring)
    grey = exposed(image, np.random.default_rng(1))
    assert len(Detector(BOXES).search(grey)) == 1
    assert not len(Detector(BOXES, replace(CAMERA, fx=3000.0, fy=3000.0)).search(grey))


def test_boxes_that_are_not_looked_for_are_not_found() -> None:
    rng = np.random.default_rng(10)
    images = [image_of(rng, pose_at(0.0, 2.3)) for _ in range(6)]
    assert track_markers(Film(images, CAMERA), TrackParameters(prototypes=(PEPSI,))).num_rows == 0


def test_images_are_looked_at_one_after_the_other_and_let_go() -> None:
    rng = np.random.default_rng(12)
    alive: list[weakref.ref[NDArray[np.uint8]]] = []
    most = 0

    class Stream(Film):
        def __iter__(self) -> Iterator[NDArray[Any]]:
            nonlocal most
            for _ in range(12):
                image = image_of(rng, pose_at(0.0, 2.3))
                alive.append(weakref.ref(image))
                most = max(most, sum(ref() is not None for ref in alive))
                yield image

    assert track_markers(Stream([rng.random(1)] * 12, CAMERA), PARAMETERS).num_rows
    assert most <= PARAMETERS.together + 1


def test_the_same_video_gives_the_same_table() -> None:
    images = film(30)
    assert track_markers(Film(images, CAMERA), PARAMETERS) == track_markers(Film(images, CAMERA), PARAMETERS)


def test_images_too_small_for_a_marker_and_no_images_give_an_empty_table() -> None:
    assert track_markers(Film([]), PARAMETERS) == MARKERS_2D.arrow.empty_table()
    tiny = Film([np.zeros((5, 7), np.uint8)] * 3)
    assert track_markers(tiny, PARAMETERS) == MARKERS_2D.arrow.empty_table()


def test_object_ids_are_the_names_and_never_the_same() -> None:
    named = [replace(SHELL, name=name) for name in ("Stella Artois", "box", "Box", "é 2", "  ", "box")]
    assert object_ids(named) == ["stella_artois", "box", "box_2", "é_2", "box_3", "box_4"]


def test_evidence_can_be_asked_for() -> None:
    rng = np.random.default_rng(11)
    grey = image_of(rng, pose_at(0.0, 2.3))
    strict = Detector(BOXES, CAMERA, evidence=Evidence(first_likeness=0.99999))
    assert len(Detector(BOXES, CAMERA).search(grey)) >= 2
    assert not len(strict.search(grey))
