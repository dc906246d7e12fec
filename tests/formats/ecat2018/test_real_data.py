"""Every real session file at hand comes back byte for byte, and says what is known about it."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from ecat.formats import export, import_source
from ecat.formats.ecat2018.files_param import SessionFile, read_files_param
from ecat.formats.ecat2018.glyphs import identify
from ecat.formats.ecat2018.session_folder import draft_of
from ecat.formats.format import ImportOptions
from ecat.geometry.cameras import KINECT_V2_COLOR
from ecat.store import find_sessions, open_session
from tests.formats.ecat2018.documents import tables_of, write

MOVIES = {
    "SampleAnnotation": 10,
    "Annotation_Test/Bao": 100,
    "Annotation_Test/Son": 101,
    "Annotation/SonMovieWorkspace": None,
    "Annotation/VanLuanMovieWorkspace": None,
}
KINECT = ("SlideAway/Session1", "SlideNext/Session2", "SlidePast/Session1")


def session_files(folder: Path) -> list[Path]:
    return sorted(folder.rglob("files.param"))


def differing(files: list[Path]) -> list[str]:
    """Files that do not come back, through the layer's XML and the tables; and what import said of them."""
    found: list[str] = []
    for file in files:
        findings: list[str] = []
        draft = draft_of(file.parent, ImportOptions(), findings)
        if write(draft.manifest, draft.layers[0], tables_of(draft)) != file.read_bytes():
            found.append(str(file))
        found += [finding for finding in findings if "export will differ" in finding]
    return found


@pytest.mark.slow
@pytest.mark.parametrize("workspace", MOVIES)
def test_every_movie_session_comes_back_byte_for_byte(shared: Path, workspace: str) -> None:
    files = session_files(shared / "ecat_movies" / workspace)
    assert len(files) == (MOVIES[workspace] or len(files)) > 0
    assert differing(files) == []


def test_all_movie_sessions_at_hand_are_tested(shared: Path) -> None:
    root = shared / "ecat_movies"
    parts = sum(len(session_files(root / workspace)) for workspace in MOVIES)
    assert parts == len(session_files(root)) == 2029


@pytest.mark.parametrize("name", KINECT)
def test_every_kinect_session_comes_back_byte_for_byte(shared: Path, name: str) -> None:
    assert differing([shared / "ecat_kinect" / name / "files.param"]) == []


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.slow
@pytest.mark.parametrize(
    "part", ["ecat_kinect", "ecat_movies/SampleAnnotation", "ecat_movies/Annotation_Test/Bao"]
)
def test_whole_workspaces_come_back_through_sessions_on_disk(shared: Path, tmp_path: Path, part: str) -> None:
    source = shared / part
    report = import_source(source, tmp_path / "made")
    assert report.sessions == len(session_files(source)) == len(find_sessions(tmp_path / "made"))
    assert export(tmp_path / "made", tmp_path / "back", format="ecat-2018").findings == ()
    assert contents(tmp_path / "back") == contents(source)


# ---------------------------------------------------------------------------------------------- facts


@pytest.fixture(scope="module")
def kinect(shared: Path) -> dict[str, SessionFile]:
    return {name: read_files_param(shared / "ecat_kinect" / name / "files.param") for name in KINECT}


def test_known_figures_of_the_recordings(kinect: dict[str, SessionFile]) -> None:
    found = {
        name: (said.n_frames, (said.clock.duration_ns or 0) // 1_000_000, len(said.layer.events))
        for name, said in kinect.items()
    }
    assert found == dict(
        zip(KINECT, [(2649, 88_357, 19), (2579, 86_039, 20), (2147, 71_811, 22)], strict=True)
    )


def test_frames_with_each_box(kinect: dict[str, SessionFile]) -> None:
    found = {
        (name, dimensions, names[faces.object_id]): int((faces.columns().orders <= 0).sum())
        for name, said in kinect.items()
        for names in [{thing.id: thing.name for thing in said.layer.objects}]
        for dimensions, groups in ((2, said.faces_2d), (3, said.faces_3d))
        for faces in groups
    }
    assert found == {
        ("SlideAway/Session1", 2, "Shell"): 1891,
        ("SlideAway/Session1", 3, "Shell"): 1891,
        ("SlideAway/Session1", 2, "Stella Artois"): 2066,
        ("SlideAway/Session1", 3, "Stella Artois"): 2065,
        ("SlideNext/Session2", 2, "Shell"): 1530,
        ("SlideNext/Session2", 3, "Shell"): 1530,
        ("SlideNext/Session2", 2, "Stella Artois"): 1991,
        ("SlideNext/Session2", 3, "Stella Artois"): 1991,
        ("SlidePast/Session1", 2, "Shell"): 1837,
        ("SlidePast/Session1", 3, "Shell"): 1837,
        ("SlidePast/Session1", 2, "Stella Artois"): 1644,
        ("SlidePast/Session1", 3, "Stella Artois"): 1644,
    }


def test_every_one_of_18_019_faces_is_a_known_glyph_seen_in_a_mirror(kinect: dict[str, SessionFile]) -> None:
    faces: Counter[str | None] = Counter()
    for said in kinect.values():
        for group in said.faces_2d:
            faces.update(said.book.codes[i] for i in group.columns().codes.tolist())
    assert sum(faces.values()) == 18_019
    for code in faces:
        found = identify(np.array([int(cell) for cell in code or ""], np.uint8).reshape(5, 5))
        assert found is not None
        assert found.mirrored


def test_missing_corners_are_those_that_were_infinite(kinect: dict[str, SessionFile]) -> None:
    missing = {
        name: sum(int(np.isnan(group.columns().corners[:, ::3]).sum()) for group in said.faces_3d)
        for name, said in kinect.items()
    }
    assert missing == {"SlideAway/Session1": 64, "SlideNext/Session2": 75, "SlidePast/Session1": 108}


def paired(said: SessionFile) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """2-D corners (n, 4, 2) and 3-D corners (n, 4, 3) of the faces that are in both lists."""
    two: list[NDArray[np.float64]] = []
    three: list[NDArray[np.float64]] = []
    for flat, deep in zip(said.faces_2d, said.faces_3d, strict=True):
        assert flat.object_id == deep.object_id
        a, b = flat.columns(), deep.columns()
        rows = {key: i for i, key in enumerate(zip(b.frames.tolist(), b.orders.tolist(), strict=True))}
        for i, key in enumerate(zip(a.frames.tolist(), a.orders.tolist(), strict=True)):
            if key in rows:
                two.append(a.corners[i].reshape(4, 2))
                three.append(b.corners[rows[key]].reshape(4, 3))
    return np.array(two), np.array(three)


@pytest.mark.parametrize("name", KINECT)
def test_trap_03_corners_pair_by_a_cyclic_shift_and_reproject_to_within_a_pixel(
    kinect: dict[str, SessionFile], name: str
) -> None:
    two, three = paired(kinect[name])
    finite = np.isfinite(three).all(axis=(1, 2))
    two, three = two[finite], three[finite]
    projected = KINECT_V2_COLOR.project(three.reshape(-1, 3)).reshape(-1, 4, 2)
    errors = np.array(
        [np.linalg.norm(np.roll(projected, -shift, axis=1) - two, axis=2).mean(axis=1) for shift in range(4)]
    )
    shifts = np.bincount(errors.argmin(axis=0), minlength=4) / len(two)
    assert shifts[1] > 0.7
    assert 0.1 < shifts[0] < 0.3
    assert shifts[3] < 0.01
    best = errors.argmin(axis=0)
    pixels = np.take_along_axis(projected, ((np.arange(4) + best[:, None]) % 4)[..., None], axis=1)
    assert (np.median(np.abs(pixels - two), axis=(0, 1)) <= 1.0).all(), "in u, and in v"


@pytest.mark.slow
def test_dangling_references_to_other_sessions_stay(shared: Path, tmp_path: Path) -> None:
    source = shared / "ecat_movies" / "SampleAnnotation"
    import_source(source, tmp_path / "made")
    targets = [
        target
        for folder in find_sessions(tmp_path / "made")
        for relation in open_session(folder).layer("main").relations
        for target in relation.targets
        if "/" in target
    ]
    assert len(targets) > 0
