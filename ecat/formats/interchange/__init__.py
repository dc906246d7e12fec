"""Annotations of other programs, in and out: each format a module, with a statement of what it cannot carry.

A reader turns a file into what was :mod:`found <ecat.formats.interchange.found>` in it, which knows nothing of a
session; :mod:`reading <ecat.formats.interchange.reading>` makes a layer of that, or a whole session.  A writer gets
:class:`what there is to say <ecat.formats.interchange.source.Source>` and says what was
:mod:`left behind <ecat.formats.interchange.leftovers>`.  Every conversion of times is in
:mod:`ecat.formats.interchange.times`.
"""

from __future__ import annotations
