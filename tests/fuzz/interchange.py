"""Annotations of other programs: whatever is in the file, what is read can be stored, and written by every format."""

from __future__ import annotations

import atexit
import shutil
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

from ecat.formats import Format, registry
from ecat.model import Layer
from ecat.progress import silent
from ecat.store import Session
from ecat.store.publish import publish
from ecat.store.xml import layer_from_xml, layer_to_xml
from tests.formats.interchange.documents import written
from tests.formats.interchange.layers import Holding, base_session

FORMATS = ("boris", "coco", "csv", "cvat-video", "elan", "epic-kitchens", "label-studio", "via", "vidat")
_FOLDER = Path(tempfile.mkdtemp(prefix="ecat-fuzz-"))
atexit.register(shutil.rmtree, _FOLDER, ignore_errors=True)


@cache
def _session() -> Session:
    return base_session(_FOLDER, "uniform", file="media/take.mp4")


def reader(name: str) -> Callable[[bytes], None]:
    """Reads a file of a format into a session that is there, and looks at what came of it."""
    form = registry.find(name)
    path = _FOLDER / f"{name}{form.suffix}"

    def run(data: bytes) -> None:
        path.write_bytes(data)
        if form.sniff is not None:
            form.sniff(path)
        assert form.read_layer is not None
        layer, _ = form.read_layer(path, _session())
        assert layer_from_xml(layer_to_xml(layer), name="main") == layer
        publish([layer], _session().manifest)
        _write(form, layer)

    return run


def _write(form: Format, layer: Layer) -> None:
    """The format that was read is written again."""
    assert form.part is not None
    dest = _FOLDER / "written"
    form.part(Holding(_session(), layer), "s", dest, form.options(), silent)


def seeds(name: str) -> tuple[bytes, ...]:
    """A file as the program writes it."""
    with tempfile.TemporaryDirectory() as folder:
        data = written(Path(folder))[name].read_bytes()
    # one of several recordings would not be that of the session
    return (data.replace(b"P01_01,", b"s,"),)
