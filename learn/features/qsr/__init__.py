"""Qualitative spatial relations of points and boxes, on whole tracks at once.

The relations are those of QSRLib, with its parameters, and equal to it wherever it has an answer; docs/qsr.md has the
table.  Each is a function from arrays of positions to an array of small integers of the same leading shape, any number
of pairs and frames in one call: of two arrays (pairs, frames, 2), ``qtc_c(a, b, threshold=0.01)`` is (pairs, frames-1).
What the integers stand for has the name of the calculus in capitals (``QTC_C``); :func:`to_names` and :func:`to_arrow`
make names of them.  :class:`Live` gives the same answers while frames arrive.
"""

from __future__ import annotations

from learn.features.qsr.boxes import ALLEN, RA, RCC2, RCC3, RCC4, RCC5, RCC8, ra, rcc2, rcc3, rcc4, rcc5, rcc8
from learn.features.qsr.codes import MISSING, to_arrow, to_names
from learn.features.qsr.continuity import chain, chains, positions
from learn.features.qsr.directions import CARDIR, MWE, TPCC, cardir, mwe, tpcc
from learn.features.qsr.distances import MOS, argd, argd_values, argprobd, argprobd_values, mos, seeded
from learn.features.qsr.live import Live, LiveChain
from learn.features.qsr.qtc import NEAR, QTC_B, QTC_BC, QTC_C, qtc_b, qtc_bc, qtc_c
from learn.features.qsr.relations import RELATIONS, Relation
from learn.features.qsr.tracks import QUALITATIVE_TRACKS, qualitative_tracks

__all__ = [
    "ALLEN",
    "CARDIR",
    "MISSING",
    "MOS",
    "MWE",
    "NEAR",
    "QTC_B",
    "QTC_BC",
    "QTC_C",
    "QUALITATIVE_TRACKS",
    "RA",
    "RCC2",
    "RCC3",
    "RCC4",
    "RCC5",
    "RCC8",
    "RELATIONS",
    "TPCC",
    "Live",
    "LiveChain",
    "Relation",
    "argd",
    "argd_values",
    "argprobd",
    "argprobd_values",
    "cardir",
    "chain",
    "chains",
    "mos",
    "mwe",
    "positions",
    "qtc_b",
    "qtc_bc",
    "qtc_c",
    "qualitative_tracks",
    "ra",
    "rcc2",
    "rcc3",
    "rcc4",
    "rcc5",
    "rcc8",
    "seeded",
    "to_arrow",
    "to_names",
    "tpcc",
]
