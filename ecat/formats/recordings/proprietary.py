"""Recordings that only their maker's programs read: known by sight, so that the error says what to do."""

from __future__ import annotations

from pathlib import Path

from ecat.errors import FormatError
from ecat.formats.format import Format, ImportOptions, ImportReport, Reader
from ecat.progress import Progress


def _starts(path: Path, suffix: str, magic: bytes) -> bool:
    if not path.is_file():
        return False
    try:
        with path.open("rb") as file:
            return path.suffix.lower() == suffix or file.read(len(magic)) == magic
    except OSError:
        return False


def _refusal(why: str, fix: str) -> Reader:
    def read(source: Path, dest: Path, options: ImportOptions, progress: Progress) -> ImportReport:
        """Say which program converts it.

        Raises
        ------
        FormatError : always.
        """
        del options, progress
        raise FormatError(
            f"cannot import {source.name}", where=why, consequence=f"nothing was written to {dest}", fix=fix
        )

    return read


XEF = Format(
    name="kinect-studio-xef",
    description="not read: Kinect Studio's .xef; says how to convert it",
    sniff=lambda path: _starts(path, ".xef", b"EVENTS1"),
    read=_refusal(
        "it is a recording of Kinect Studio (XEF), whose layout Microsoft has not published",
        "open it on Windows in Kinect Studio 2.0 (KStudio, Kinect for Windows SDK 2.0), play it into a program that "
        "saves colour as video and depth as 16-bit PNG images, and import the folder of these",
    ),
)
ONI = Format(
    name="openni-oni",
    description="not read: OpenNI's .oni; says how to convert it",
    sniff=lambda path: _starts(path, ".oni", b"NI10"),
    read=_refusal(
        "it is a recording of OpenNI (ONI), which only the library OpenNI2 reads",
        "play it with OpenNI2 (NiViewer, or a few lines around openni2.Device.open_file), save colour and depth as "
        "images, depth as 16-bit PNG, and import the folder of these",
    ),
)
