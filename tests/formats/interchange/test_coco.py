"""COCO: read by COCO's own program, and files as others write them."""

from __future__ import annotations

import contextlib
import io
import json
from pathlib import Path
from typing import Any

import pytest

from ecat.errors import LimitError
from ecat.formats.interchange import coco
from ecat.formats.interchange.coco import FORMAT
from ecat.model import AnnotatedObject, KeyFrame, Layer
from ecat.model.shapes import shape_at
from ecat.progress import silent
from ecat.sample import sample_session
from ecat.store import Session, create_session
from tests.formats.interchange.documents import COCO as DOCUMENT
from tests.formats.interchange.layers import base_session


def opened(path: Path) -> Any:
    """The file in pycocotools, which talks while it reads."""
    library: Any = pytest.importorskip("pycocotools.coco")
    with contextlib.redirect_stdout(io.StringIO()):
        return library.COCO(str(path))


@pytest.fixture(scope="module")
def sample(tmp_path_factory: pytest.TempPathFactory) -> tuple[Session, Any, dict[str, Any]]:
    folder = Path(tmp_path_factory.mktemp("coco"))
    draft, _ = sample_session(seed=1, actions=("next",))
    session = create_session(folder / "s", draft)
    assert FORMAT.part is not None
    FORMAT.part(session, "s", folder / "a.json", FORMAT.options(), silent)
    return session, opened(folder / "a.json"), json.loads((folder / "a.json").read_text())


def test_cocos_own_program_reads_every_image_and_annotation(sample: Any) -> None:
    session, coco, data = sample
    assert sorted(coco.getImgIds()) == list(range(1, session.manifest.n_frames + 1))
    assert len(coco.getAnnIds()) == len(data["annotations"]) > 0
    for annotation in coco.loadAnns(coco.getAnnIds(imgIds=[1])):
        assert annotation["area"] > 0


@pytest.mark.filterwarnings("ignore:__array__ implementation doesn't accept a copy:DeprecationWarning")
def test_cocos_own_program_draws_the_shapes(sample: Any) -> None:
    _, coco, data = sample
    polygons = [a["id"] for a in data["annotations"] if a["segmentation"]][:20]
    for annotation in coco.loadAnns(polygons):
        mask = coco.annToMask(annotation)
        assert mask.sum() == pytest.approx(annotation["area"], rel=0.1, abs=60)


def test_bodies_are_key_points_with_bones(sample: Any) -> None:
    _, coco, data = sample
    (person,) = coco.loadCats([c["id"] for c in data["categories"] if "keypoints" in c])
    assert "HandRight" in person["keypoints"]
    assert all(1 <= end <= len(person["keypoints"]) for bone in person["skeleton"] for end in bone)
    bodies = coco.loadAnns(coco.getAnnIds(catIds=[person["id"]]))
    assert {len(body["keypoints"]) for body in bodies} == {3 * len(person["keypoints"])}
    for body in bodies[:50]:
        assert body["num_keypoints"] == sum(v > 0 for v in body["keypoints"][2::3])


def test_tracks_tell_which_object_an_annotation_is_of(sample: Any) -> None:
    session, _, data = sample
    names = {track["id"]: track["name"] for track in data["tracks"]}
    assert set(names.values()) == {"Performer 1", "Shell", "Stella Artois", "table"}
    faces = {a["image_id"] for a in data["annotations"] if names[a["track_id"]] == "Shell"}
    seen = session.table("markers_2d").to_arrow().to_pylist()
    corners = {r["frame"] + 1 for r in seen if r["object_id"] == "o2" and r["u0_px"] is not None}
    assert faces == corners


def test_tables_may_be_left_out(tmp_path: Path) -> None:
    draft, _ = sample_session(seed=1, actions=("next",))
    session = create_session(tmp_path / "s", draft)
    assert FORMAT.part is not None
    FORMAT.part(session, "s", tmp_path / "a.json", FORMAT.options(tracked=False), silent)
    data = json.loads((tmp_path / "a.json").read_text())
    assert [track["name"] for track in data["tracks"]] == ["table"]


def test_others_files_become_objects_by_instance(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text(json.dumps(DOCUMENT))
    assert FORMAT.read_layer is not None
    layer, findings = FORMAT.read_layer(tmp_path / "a.json", base_session(tmp_path, "uniform"))
    cube, other = layer.objects
    assert (cube.semantic_type, cube.kind) == ("cube", "rectangle")
    assert [shape_at(cube, frame) for frame in range(4)] == [(1, 2, 3, 4), (2, 2, 3, 4), None, None]
    assert (other.kind, shape_at(other, 2)) == ("polygon", (0, 0, 5, 0, 5, 5))
    assert findings[0] == "1 annotation that draw no single shape left out: bodies, masks"


def test_a_point_is_one_key_point(tmp_path: Path) -> None:
    tip = AnnotatedObject(id="o1", kind="point", key_frames=(KeyFrame(frame=3, coordinates=(5, 6)),))
    session = base_session(tmp_path, "uniform", Layer(objects=(tip,)))
    assert FORMAT.part is not None
    FORMAT.part(session, "s", tmp_path / "a.json", FORMAT.options(), silent)
    first = json.loads((tmp_path / "a.json").read_text())["annotations"][0]
    assert (first["image_id"], first["keypoints"], first["num_keypoints"]) == (4, [5, 6, 2], 1)


def test_more_images_than_anybody_lists_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(coco, "MOST_IMAGES", 50)
    assert FORMAT.part is not None
    with pytest.raises(LimitError, match="90 images"):
        FORMAT.part(base_session(tmp_path, "uniform"), "s", tmp_path / "a.json", FORMAT.options(), silent)
