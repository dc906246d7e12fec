"""Small `files.param` documents in ECAT's own layout, and the way there and back."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import pyarrow as pa

from ecat.formats.ecat2018.files_param import SessionFile, read_files_param
from ecat.formats.ecat2018.files_param_write import files_param
from ecat.formats.ecat2018.session_folder import draft_of
from ecat.formats.format import ImportOptions
from ecat.model import Layer, Manifest
from ecat.store import Draft
from ecat.store.xml import layer_from_xml, layer_to_xml

BOM = b"\xef\xbb\xbf"
DECLARATION = '<?xml version="1.0" encoding="utf-8"?>\n'
CODE = "1 ,1 ,1 ,0 ,1 ,1 ,0 ,0 ,1 ,0 ,1 ,0 ,0 ,1 ,0 ,1 ,0 ,0 ,1 ,0 ,1 ,0 ,0 ,1 ,0 "
CORNERS = "859,654,915,637,916,694,862,712"
POINTS = (
    "-0.1955648,-0.2209547,1.445,-0.1970665,-0.1404356,1.426,-0.1241636,-0.1219175,1.483,-0.125,-0.2,1.493"
)
STANDARD = 'filename="a.avi" objectType="2D" generate="MANUAL" color="-65536" borderSize="1" semanticType=""'
RECTANGLE = "Annotator.RectangleObject"


def obj(body: str = "", *, id: str = "o1", name: str = "cup", shape: str = RECTANGLE, extra: str = "") -> str:  # noqa: A002
    """An object in ECAT's layout; `body` in whole lines."""
    head = f'    <object id="{id}" name="{name}" {STANDARD} shape="{shape}"{extra}'
    return f"{head}>\n{body}    </object>\n" if body else f"{head} />\n"


def markers(*lines: str, tag: str = "markers") -> str:
    """A list of markers, each without indentation."""
    body = "".join(f"        {line}\n" for line in lines)
    return f"      <{tag}>\n{body}      </{tag}>\n"


def location(frame: int, text: str = "1,2,3,4") -> str:
    """A drawn marker."""
    return f'<marker type="LOCATION" frame="{frame}">{text}</marker>'


def face(corners: str = CORNERS, code: str = CODE) -> str:
    """A face in whole lines."""
    return (
        f"          <face>\n            <bounding>{corners}</bounding>\n"
        f"            <code>{code}</code>\n          </face>\n"
    )


def box_marker(frame: int, *faces: str, dimensions: int = 2, size: int = 5) -> str:
    """A marker of a glyph box, in whole lines."""
    kind = 'type="LOCATION" ' if dimensions == 2 else ""
    head = f'        <marker {kind}frame="{frame}" glyphSize="{size}"'
    return f"{head}>\n{''.join(faces)}        </marker>\n" if faces else f"{head} />\n"


def box(two: str, three: str = "", **said: str) -> str:
    """A glyph box with the markers `two` and `three`, in whole lines."""
    lists = f"      <markers>\n{two}      </markers>\n"
    if three:
        lists += f"      <markers3d>\n{three}      </markers3d>\n"
    return obj(lists, **{"shape": "Annotator.GlyphBoxObject", "name": "Shell", **said})


def event(text: str = "pour", *, id: str = "a1", start: int = 1, end: int = 9, rest: str = "") -> str:  # noqa: A002
    """An annotation; `rest` replaces the three empty lists at its end."""
    said = f"<text>{text}</text>" if text else "<text />"
    rest = rest or "      <refs />\n      <events />\n      <link />\n"
    return (
        f'    <annotation id="{id}">\n      <duration startFrame="{start}" endFrame="{end}" />\n'
        f"      {said}\n{rest}    </annotation>\n"
    )


def predicate(frame: int, ids: str, kind: str, q: str = "True") -> str:
    """A predicate."""
    count = ids.count(",") + 1
    return f'    <predicate frame="{frame}" arguments="{count}" ids="{ids}" q="{q}" type="{kind}" />\n'


def section(name: str, body: str) -> str:
    """A section of the session, `<name />` when empty."""
    head = name.partition(" ")[0]
    return f"  <{name}>\n{body}  </{head}>\n" if body else f"  <{name} />\n"


def document(
    *,
    objects: str = "",
    events: str = "",
    predicates: str | None = None,
    files: str = "",
    head: str = 'name="Session1" length="100"',
    annotations: str = "annotations",
) -> str:
    """A whole document; without `predicates` there is no such section."""
    sections = [("files", files), ('objects no="5"', objects), (annotations, events)]
    sections += [] if predicates is None else [("predicates", predicates)]
    body = "".join(section(name, lines) for name, lines in sections)
    return f"{DECLARATION}<session {head}>\n{body}</session>"


@dataclass(frozen=True)
class Trip:
    """A document that was read, and what came back."""

    source: bytes
    draft: Draft
    tables: dict[str, pa.Table]
    back: bytes
    findings: list[str]

    @property
    def layer(self) -> Layer:
        return self.draft.layers[0]

    @property
    def manifest(self) -> Manifest:
        return self.draft.manifest

    @property
    def is_exact(self) -> bool:
        return self.back == self.source


def save(folder: Path, text: str | bytes) -> Path:
    """Write `files.param` of `folder`/Session1 (text with a byte order mark)."""
    path = folder / "Session1" / "files.param"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(BOM + text.encode() if isinstance(text, str) else text)
    return path


def read(text: str | bytes, *, skip_bad_markers: bool = False) -> SessionFile:
    """Read a document."""
    with tempfile.TemporaryDirectory() as folder:
        return read_files_param(save(Path(folder), text), skip_bad_markers=skip_bad_markers)


def tables_of(draft: Draft) -> dict[str, pa.Table]:
    """The tables of marks."""
    return {
        name: pa.Table.from_batches(list(cast("Iterable[pa.RecordBatch]", table.data)))
        for name, table in draft.tables.items()
    }


def write(manifest: Manifest, layer: Layer, tables: dict[str, pa.Table]) -> bytes:
    """What export writes; the layer passes through its XML."""
    again = layer_from_xml(layer_to_xml(layer), name="main")
    return b"".join(files_param(manifest, again, tables.get, []))


def trip(text: str | bytes, *, skip_bad_markers: bool = False) -> Trip:
    """There and back, with a byte order mark if `text` is a text."""
    with tempfile.TemporaryDirectory() as folder:
        path = save(Path(folder), text)
        findings: list[str] = []
        draft = draft_of(path.parent, ImportOptions(skip_bad_markers=skip_bad_markers), findings)
        tables = tables_of(draft)
        back = write(draft.manifest, draft.layers[0], tables)
        return Trip(path.read_bytes(), draft, tables, back, findings)
