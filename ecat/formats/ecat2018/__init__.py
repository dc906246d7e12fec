"""ECAT 2018: the sessions, projects and workspaces of the annotator of 2015-2018, in and out."""

from __future__ import annotations

from ecat.formats.ecat2018.side_files import SIDE_FILES
from ecat.formats.ecat2018.workspace import NAME, Ecat2018Options, read, sniff, write
from ecat.formats.format import Format

FORMAT = Format(
    name=NAME,
    description="sessions, projects and workspaces of ECAT (2015-2018)",
    sniff=sniff,
    read=read,
    write=write,
    options=Ecat2018Options,
    side_files=SIDE_FILES,
)
