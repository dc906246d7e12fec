"""Foreign formats by name: ecat's own and those that other packages add as entry points (group ``ecat.formats``).

An entry point names a :class:`ecat.formats.format.Format`: ``module:NAME``, or a module that calls it ``FORMAT``.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path

from ecat.errors import FormatError, NotFoundError, UsageError
from ecat.formats.format import Format, SideFile

GROUP = "ecat.formats"
_OWN = {
    "azure-mkv": "ecat.formats.recordings.azure_mkv",
    "boris": "ecat.formats.interchange.boris",
    "bvh": "ecat.formats.robotics.bvh",
    "coco": "ecat.formats.interchange.coco",
    "csv": "ecat.formats.interchange.plain_csv",
    "cvat-video": "ecat.formats.interchange.cvat",
    "ecat-2018": "ecat.formats.ecat2018",
    "ecat-learning": "ecat.formats.recordings.ecat_learning",
    "ecat-recorder": "ecat.formats.recordings.ecat_recorder",
    "elan": "ecat.formats.interchange.elan",
    "epic-kitchens": "ecat.formats.interchange.epic",
    "glb": "ecat.formats.robotics.glb",
    "images": "ecat.formats.recordings.images",
    "kinect-studio-xef": "ecat.formats.recordings.proprietary:XEF",
    "label-studio": "ecat.formats.interchange.label_studio",
    "lerobot": "ecat.formats.lerobot",
    "mcap": "ecat.formats.robotics.mcap",
    "movie": "ecat.formats.robotics.movie",
    "ntu-skeleton": "ecat.formats.robotics.ntu",
    "openni-oni": "ecat.formats.recordings.proprietary:ONI",
    "parquet": "ecat.formats.datasets.tidy",
    "ply": "ecat.formats.robotics.ply",
    "poses": "ecat.formats.poses",
    "poses-smooth": "ecat.formats.poses:SMOOTH",
    "rgbd-video": "ecat.formats.recordings.rgbd_video",
    "rlds": "ecat.formats.datasets.rlds",
    "rosbag": "ecat.formats.recordings.rosbag",
    "rrd": "ecat.view.rrd",
    "tum-rgbd": "ecat.formats.recordings.tum",
    "torch": "ecat.formats.datasets.torch_format",
    "tum-trajectories": "ecat.formats.robotics.tum",
    "via": "ecat.formats.interchange.via",
    "vidat": "ecat.formats.interchange.vidat",
    "video": "ecat.formats.recordings.video",
    "voxml": "ecat.formats.robotics.voxml",
    "voxsim-demonstrations": "ecat.formats.robotics.demonstrations",
    "webdataset": "ecat.formats.datasets.webdataset",
}


@cache
def all_formats() -> tuple[Format, ...]:
    """Every format, in the order of their names.  Ecat's own are there even if it runs from a bare checkout."""
    return tuple(_each())


def _each() -> Iterator[Format]:
    """The same, each loaded when it is its turn."""
    return (load(name, value) for name, value in sorted(places().items()))


@cache
def places() -> dict[str, str]:
    """Where each format is: ``module:NAME`` by its name."""
    return _OWN | {point.name: point.value for point in entry_points(group=GROUP)}


@cache
def load(name: str, value: str) -> Format:
    """The format that ``module:NAME`` is; of another package one that says why it cannot be loaded."""
    module, _, attribute = value.partition(":")
    try:
        return getattr(import_module(module), attribute or "FORMAT")
    except Exception as error:  # another package's fault must not take ecat's formats with it
        if name in _OWN:
            raise
        return Format(name=name, description=f"cannot be loaded: {type(error).__name__}: {error}")


def find(name: str) -> Format:
    """The format called ``name``; no other one is loaded.

    Raises
    ------
    UsageError : there is none; the message lists those there are.
    """
    if name in places():
        return load(name, places()[name])
    names = ", ".join(sorted(places()))
    raise UsageError(f"unknown format {name!r}", where=f"known formats: {names}", fix="ecat formats")


def own_modules(name: str) -> list[str]:
    """The module of the format called ``name``, not imported, if it is one of ecat's."""
    return [_OWN[name].partition(":")[0]] if name in _OWN else []


def refuse_own(path: Path) -> None:
    """Say so when ``path`` is what an import makes.

    Raises
    ------
    FormatError : it is a session or a project of ecat already.
    """
    from ecat.store.manifest import PROJECT_FILE, SESSION_FILE

    folder = path.parent if path.name in {SESSION_FILE, PROJECT_FILE} else path
    for kind, file in (("session", SESSION_FILE), ("project", PROJECT_FILE)):
        # a recording of another program may have a file of that name
        if (folder / file).is_file() and not (folder / "files.param").exists():
            raise FormatError(
                f"cannot import {path}",
                where=f"{folder} is an ecat {kind} already: there is {file} in it",
                consequence="nothing was written",
                fix=f"ecat info {folder} shows what is in it, ecat process {folder} computes the rest",
            )


def sniff(path: Path) -> Format:
    """The format that ``path`` looks like.

    Raises
    ------
    NotFoundError : nothing is there.
    FormatError : it looks like none.
    """
    if not path.exists():
        raise NotFoundError(f"cannot import {path}", where="no such file or folder", fix="check the path")
    for known in _each():
        if known.sniff is not None and known.sniff(path):
            return known
    raise FormatError(
        f"cannot import {path}",
        where="it looks like none of the formats that ecat reads",
        consequence="nothing was written",
        fix="ecat formats lists them; --format NAME insists on one",
    )


def side_file(path: Path) -> SideFile | None:
    """The kind of side file that the file at ``path`` looks like, if any."""
    kinds = (kind for known in _each() for kind in known.side_files)
    return next((kind for kind in kinds if kind.sniff(path)), None)
