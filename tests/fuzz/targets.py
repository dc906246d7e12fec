"""The readers under test: one line each.

A target takes any bytes. It returns, or raises one `EcatError`; anything else is a finding. Targets whose
writer has one canonical form also check that what was read is written and read again the same.
"""

from __future__ import annotations

import json
import tempfile
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar, cast

import av
import cv2
import numpy as np

from ecat.errors import EcatError
from ecat.formats import import_source
from ecat.formats.ecat2018.body_scheme import (
    KINECT_V2,
    BodyScheme,
    Joint,
    read_body_scheme,
    write_body_scheme,
)
from ecat.formats.ecat2018.coordinate_mapping import (
    CoordinateMapping,
    read_coordinate_mapping,
    write_coordinate_mapping,
)
from ecat.formats.ecat2018.depth_file import DepthFile, write_depth_file
from ecat.formats.ecat2018.files_param import read_files_param
from ecat.formats.ecat2018.glyphs import code_of, read_glyph, write_glyph
from ecat.formats.ecat2018.learning_export import read_learning_export, write_learning_export
from ecat.formats.ecat2018.mark_tables import mark_batches
from ecat.formats.ecat2018.number_text import format_float32, parse_floats
from ecat.formats.ecat2018.options import (
    Exclusive,
    Options,
    PredicateForm,
    Unique,
    read_options,
    write_options,
)
from ecat.formats.ecat2018.program_params import ProgramParams, read_program_params, write_program_params
from ecat.formats.ecat2018.project_list import read_project_list, write_project_list
from ecat.formats.ecat2018.rig import read_rig, write_rig
from ecat.formats.ecat2018.voxml import read_voxml, write_voxml
from ecat.formats.ecat2018.xml_input import iter_records, iterparse_safe, parse_safe
from ecat.formats.recordings.image_files import decode as decode_image
from ecat.formats.recordings.k4a_calibration import cameras_of
from ecat.formats.recordings.known_cameras import parse_calibration
from ecat.formats.recordings.ntu import joint_rows
from ecat.formats.recordings.ntu import parse as parse_ntu
from ecat.formats.recordings.rows import trajectory_rows
from ecat.formats.recordings.timed_lists import parse_lines, parse_rows
from ecat.model import AnnotatedObject, Event, KeyFrame, Layer, Manifest, Relation, Segment
from ecat.model.annotation import Argument
from ecat.model.prototype import NOMINAL_BOXES
from ecat.model.scheme import ECAT_2018_SCHEME
from ecat.process import read_prototypes
from ecat.store.manifest import dump_manifest, parse_manifest
from ecat.store.media.truncation import bytes_missing
from ecat.store.xml import layer_from_xml, layer_to_xml, scheme_from_xml, scheme_to_xml
from tests.formats.recordings.k4a import calibration, jpeg, recording
from tests.formats.recordings.k4a import depth as depth_image
from tests.formats.recordings.k4a import write as write_k4a
from tests.fuzz import annotation, interchange

if TYPE_CHECKING:
    from av import VideoStream

T = TypeVar("T")


@dataclass(frozen=True)
class Target:
    """A reader: ``run`` takes any bytes, ``seeds`` are files it reads."""

    run: Callable[[bytes], object]
    seeds: tuple[bytes, ...]


@dataclass(frozen=True)
class Interchange:
    """A reader of another program's annotations, which is loaded when it is asked: searches load their reader alone."""

    name: str

    @cached_property
    def run(self) -> Callable[[bytes], object]:
        return interchange.reader(self.name)

    @cached_property
    def seeds(self) -> tuple[bytes, ...]:
        return interchange.seeds(self.name)


def drain(items: Iterable[object]) -> None:
    """Read a stream to its end, keeping nothing."""
    deque(items, maxlen=0)


def stable(read: Callable[[bytes], T], write: Callable[[T], bytes]) -> Callable[[bytes], None]:
    """A reader, and that a written file is read and written again the same."""

    def run(data: bytes) -> None:
        written = write(read(data))
        assert write(read(written)) == written, "a written file is not written again the same"

    return run


def numbers(data: bytes) -> None:
    values = parse_floats(data.decode("utf-8", "replace"))
    assert format_float32(parse_floats(format_float32(values))) == format_float32(values)


def xml(data: bytes) -> None:
    parse_safe(data, what="cannot read it")
    drain(iterparse_safe(data, tags=("a",), what="cannot read it"))
    drain(iter_records(data, tags=("a",), whole=("b",), what="cannot read it"))


def xml_stream(data: bytes) -> None:
    drain(iterparse_safe(data, tags=("a", "b"), what="cannot read it"))


def from_path(read: Callable[[Path], object]) -> Callable[[bytes], None]:
    """A reader that wants a path."""

    def run(data: bytes) -> None:
        with tempfile.NamedTemporaryFile() as file:
            file.write(data)
            file.flush()
            read(Path(file.name))

    return run


def depth(path: Path) -> None:
    with DepthFile(path) as opened:
        for i in range(min(len(opened), 8)):
            opened.frame(i)


def files_param(path: Path) -> None:
    for skip_bad_markers in (True, False):
        said = read_files_param(path, skip_bad_markers=skip_bad_markers)
        for groups in (said.faces_2d, said.faces_3d):
            if groups:
                drain(mark_batches(groups, said.book, said.clock, said.n_frames))


def tum(data: bytes) -> None:
    parse_lines(data, "rgb.txt")
    parse_rows(data, "groundtruth.txt", 7)


def images(data: bytes) -> None:
    for deep in (False, True):
        # the header decides how much is decoded, and the two have to agree
        with suppress(EcatError):
            decode_image(data, "cannot read it", "it", deep=deep)


def calibration_json(data: bytes) -> None:
    with suppress(ValueError, RecursionError):
        parse_calibration(json.loads(data), "intrinsics.json", (64, 48), (64, 48))


def trajectory(path: Path) -> None:
    rows, _ = trajectory_rows(path, "color")
    drain(rows or ())


def _image_seeds() -> tuple[bytes, ...]:
    deep = np.arange(12, dtype=np.uint16).reshape(3, 4)
    pixels = np.zeros((3, 4, 3), np.uint8)
    kinds = (
        (".png", deep),
        (".png", pixels),
        (".jpg", pixels),
        (".pgm", deep),
        (".ppm", pixels),
        (".tiff", deep),
    )
    return tuple(cv2.imencode(suffix, image)[1].tobytes() for suffix, image in (*kinds, (".bmp", pixels)))


def _depth_seed() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "seed.dep"
        write_depth_file(path, [(0, np.eye(3, dtype=np.uint16)), (33, np.ones((3, 3), np.uint16))])
        return path.read_bytes()


_FORM = PredicateForm("SUPPORT", (1, 2))
_OPTIONS = Options(
    event_predicates=(_FORM,),
    glyph_prototype_path="a",
    object_predicates=(_FORM, PredicateForm("SIT", (1,))),
    constraints=(Unique(_FORM, (2,)), Exclusive((PredicateForm("SIT", (1,)),))),
)
_RIG_SCHEME = BodyScheme((Joint("Neck"), Joint("Head")), ((0, 1),))
_RIG = (
    '<BodyDataSequence><Body_Data><Subject id="3"/>'
    '<Timestamp time="2017-10-04T22:35:30.583746Z" timeFromBegin="33" frame="1"/>'
    '<Skeleton_Joint_Locations_Orig><Pts unit="m">1,2,3,4E-05,5,6</Pts></Skeleton_Joint_Locations_Orig>'
    '<Skeleton_Depth_Joint_Locations><Pts unit="m">1,2,3,4</Pts></Skeleton_Depth_Joint_Locations>'
    '<Skeleton_ImgPlane_Joint_Locations><Pts unit="px">1,2,-∞,∞</Pts></Skeleton_ImgPlane_Joint_Locations>'
    "<Skeleton_Joint_Confidences><Vals>1,0.5</Vals></Skeleton_Joint_Confidences>"
    "</Body_Data></BodyDataSequence>"
).encode()
_VOXML = (
    b"<VoxML><Lex><Pred>table</Pred><Type>physobj*artifact</Type></Lex><Type><Head>sheet[1]</Head>"
    b'<Components><Component Value="leg[2]+"/></Components><Concavity>Flat</Concavity><RotatSym>Y</RotatSym>'
    b'</Type><Habitat><Intrinsic><Intr Name="UP" Value="align(Y,E_y)"/></Intrinsic><Extrinsic/></Habitat>'
    b'<Afford_Str><Affordances><Affordance Formula="H[3]-&gt;[put(x,on([1]))]on([1],x)"/></Affordances>'
    b"</Afford_Str><Embodiment>"
    b"<Scale>agent</Scale><Movable>true</Movable></Embodiment><Other/></VoxML>"
)
_EXPORT = (
    '<project><session name="a"><data><frame no="0">'
    f'<o type="rig">{",".join(["1.5"] * 39)}</o><o type="glyph">{",".join(["2"] * 12)}</o>'
    f'<o type="glyph">{",".join(["0"] * 12)}</o></frame></data><events>'
    '<event start="0" end="20">Subject,None,Theme,pulls,From</event></events></session>'
    '<session name="b"/></project>'
).encode()
_FACE = "<face>\n<bounding>1,2,3,4,5,6,7,8</bounding>\n<code>1 ,0 ,0 ,1 </code>\n</face>\n"
_FACE_3D = _FACE.replace("1,2,3,4,5,6,7,8", "1,2,3,4,5,6,7,8,9,-∞,-∞,-∞")
_OBJECT = (
    'filename="C:\\a.avi" objectType="3D" generate="TRACKED" color="-65536" borderSize="1" semanticType=""'
)
_FILES_PARAM = (
    '<session name="s" length="9" duration="300" startWriteRGB="2017-10-04T22:35:30.583746Z">\n'
    '<files>\n<file>a.avi</file>\n</files>\n<objects no="2">\n'
    f'<object id="o1" name="Shell" {_OBJECT} shape="Annotator.GlyphBoxObject">\n<markers>\n'
    f'<marker type="LOCATION" frame="0" glyphSize="2">\n{_FACE}</marker>\n</markers>\n<markers3d>\n'
    f'<marker frame="0" glyphSize="2">\n{_FACE_3D}</marker>\n</markers3d>\n</object>\n'
    f'<object id="o2" name="man" {_OBJECT} shape="Rectangle">\n<markers>\n'
    '<marker type="LOCATION" frame="0">1,2,3E-05,4</marker>\n<marker type="DELETE" frame="3" />\n</markers>\n'
    '<links><link frame="1"><linkTo otherSession="t" id="o1" q="False" type="LOOK_AT" /></link></links>\n'
    '</object>\n</objects>\n<annotations>\n<annotation id="a1">\n<duration startFrame="0" endFrame="8" />\n'
    '<text>Slide</text>\n<refs><ref start="0" end="5" refTo="o1" /></refs>\n'
    '<events><event start="0" end="5" semanticType="Slide" /></events>\n'
    '<link><linkTo id="a1" type="CAUSE(X,Y)" /></link>\n</annotation>\n</annotations>\n<predicates>\n'
    '<predicate frame="0" arguments="2" ids="o1,t/o2" q="True" type="IDENTITY(X,Y)" />\n'
    "</predicates>\n</session>"
).encode()
_NTU = b"2\n1\n7 0 0\n25\n" + b"0.1 0.2 3 4 5 6 7 1 0 0 0 2\n" * 25 + b"0\n"
_TUM = b"# timestamp filename\n1305031102.175304 rgb/1.png\n1305031102.1 1 2 3 0 0 0 1\n"
_MAPPING = CoordinateMapping(np.ones((2, 3, 2), np.float32), np.full((2, 3, 2), 2, np.float32))

_LAYER = Layer(
    object_counter=2,
    objects=(
        AnnotatedObject(
            id="o1", name="a & b", kind="rectangle", key_frames=(KeyFrame(frame=-1, coordinates=(1.5, 2)),)
        ),
    ),
    events=(Event(id="a1", text=" slide\n", segments=(Segment(start_frame=0, end_frame=9),)),),
    relations=(Relation(predicate="ON", start_frame=0, arguments=(Argument(target="o1"),)),),
)


def json_or_none(data: bytes) -> object:
    try:
        return json.loads(data)
    except (ValueError, RecursionError):
        return None


def azure(path: Path) -> None:
    with tempfile.TemporaryDirectory() as folder:
        import_source(path, Path(folder) / "session", format="azure-mkv")


def video(path: Path) -> None:
    with tempfile.TemporaryDirectory() as folder:
        import_source(path, Path(folder) / "session", format="video")


def rgbd_video(path: Path) -> None:
    """As the depth of a recording; its colour is what the target video reads."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "in"
        folder.mkdir()
        (folder / "depth.mkv").symlink_to(path)
        import_source(folder, Path(name) / "session", format="rgbd-video")


def _video_seed(suffix: str, codec: str, pix_fmt: str) -> bytes:
    """Three small images in a container."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"seed{suffix}"
        with av.open(str(path), "w") as out:
            stream = cast("VideoStream", out.add_stream(codec, rate=30))
            stream.width, stream.height, stream.pix_fmt = 32, 32, pix_fmt
            for i in range(3):
                frame = av.VideoFrame.from_ndarray(np.full((32, 32), 40 * i, np.uint16), format="gray16le")
                out.mux(stream.encode(frame.reformat(format=pix_fmt)))
            out.mux(stream.encode(None))
        return path.read_bytes()


def _azure_seed(**changes: object) -> bytes:
    small = {"color": [jpeg(0, (32, 32))], "depth": [depth_image(0, (32, 32))], "color_px": (32, 32)}
    with tempfile.TemporaryDirectory() as folder:
        made = recording(1, **(small | {"depth_px": (32, 32)} | changes))
        return write_k4a(Path(folder) / "seed.mkv", made).read_bytes()


TARGETS: dict[str, Target | Interchange] = {
    "calibration_json": Target(
        calibration_json,
        (
            b'{"fx": 1, "fy": 1, "cx": 1, "cy": 1, "width": 64, "height": 48, "depth_scale": 5000}',
            b'{"color": {"intrinsic_matrix": [5, 0, 0, 0, 5, 0, 3, 2, 1]}, "depth": {"K": [[1, 0, 2], [0, 1, 2]]}}',
        ),
    ),
    "azure_mkv": Target(
        from_path(azure), (_azure_seed(), _azure_seed(calibration=None, tags=False, color=[]))
    ),
    "body_scheme": Target(
        stable(read_body_scheme, write_body_scheme),
        (write_body_scheme(KINECT_V2), write_body_scheme(_RIG_SCHEME)),
    ),
    "coordinate_mapping": Target(
        stable(read_coordinate_mapping, write_coordinate_mapping), (write_coordinate_mapping(_MAPPING),)
    ),
    "depth_file": Target(from_path(depth), (_depth_seed(), _depth_seed()[:-9])),
    "files_param": Target(from_path(files_param), (_FILES_PARAM,)),
    "glyphs": Target(stable(read_glyph, write_glyph), (write_glyph(code_of(5)),)),
    "journal": Target(annotation.journal, (annotation.journal_seed(),)),
    "k4a_calibration": Target(
        lambda data: cameras_of(json_or_none(data), color_px=(1280, 720), depth_px=(640, 576)),
        (json.dumps(calibration()).encode(),),
    ),
    "image": Target(images, _image_seeds()),
    "layer": Target(
        stable(lambda data: layer_from_xml(data, name="layer"), layer_to_xml), (layer_to_xml(_LAYER),)
    ),
    "learning_export": Target(
        lambda data: drain(write_learning_export(read_learning_export(data))), (_EXPORT,)
    ),
    "manifest": Target(
        stable(
            lambda data: parse_manifest(data, Path("session.json"), Manifest),
            lambda manifest: dump_manifest(manifest, Path("session.json")),
        ),
        (dump_manifest(Manifest(name="s", created="2024-01-01"), Path("session.json")),),
    ),
    "media_ends": Target(
        from_path(bytes_missing), (_azure_seed()[:200], b"RIFF\x10\0\0\0AVI LIST", b"\0\0\0\x08ftyp")
    ),
    "ntu": Target(lambda data: drain(joint_rows(parse_ntu(data))), (_NTU, _NTU[:-90])),
    "numbers": Target(numbers, ("-∞,1.5,-3.652977E-05,NaN".encode(), b"859,654")),
    "operations": Target(annotation.operations, annotation.operation_seeds()),
    "options": Target(stable(read_options, write_options), (write_options(_OPTIONS),)),
    "program_params": Target(
        stable(read_program_params, write_program_params), (write_program_params(ProgramParams("a", ("b",))),)
    ),
    "project_list": Target(stable(read_project_list, write_project_list), (b"Session1\r\nSession2\r\n",)),
    "prototypes": Target(
        from_path(read_prototypes),
        (json.dumps({"version": 1, "boxes": [box.to_dict() for box in NOMINAL_BOXES]}).encode(),),
    ),
    "rig": Target(
        lambda data: drain(write_rig(read_rig(data, _RIG_SCHEME).joints, _RIG_SCHEME)), (_RIG, _RIG[:-60])
    ),
    "scheme": Target(
        stable(lambda data: scheme_from_xml(data, name="scheme"), scheme_to_xml),
        (scheme_to_xml(ECAT_2018_SCHEME),),
    ),
    "trajectory": Target(from_path(trajectory), (b"0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n" * 2,)),
    "tum": Target(tum, (_TUM,)),
    "rgbd_video": Target(
        from_path(rgbd_video),
        (_video_seed(".mkv", "ffv1", "gray16le"), _video_seed(".avi", "ffv1", "gray12le")),
    ),
    "video": Target(
        from_path(video),
        (
            _video_seed(".mp4", "h264", "yuv420p"),
            _video_seed(".avi", "mpeg4", "yuv420p"),
            _video_seed(".webm", "vp9", "yuv420p")[:-50],
        ),
    ),
    "voxml": Target(stable(read_voxml, write_voxml), (_VOXML,)),
    "xml": Target(xml, (b'<?xml version="1.0" encoding="utf-8"?><r b="1"><a>x<!--c--></a><a/>&lt;</r>',)),
    **{name: Interchange(name) for name in interchange.FORMATS},
    "xml_stream": Target(xml_stream, (b"<r><a><b/><c/></a><![CDATA[x]]><b>&#65;</b></r>",)),
}
"""Name -> reader; a new reader is one line here."""
