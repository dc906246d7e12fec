"""How far annotators agree: coefficients, spans, objects, relations; and where they do not."""

from __future__ import annotations

from ecat.annotate.agreement.compare import Agreement
from ecat.annotate.agreement.disagreements import Disagreement, disagreements
from ecat.annotate.agreement.rated import Columns, rated_figures
from ecat.annotate.agreement.ratings import (
    cohen_kappa,
    confusion,
    fleiss_kappa,
    krippendorff_alpha,
    patterns_of,
)
from ecat.annotate.agreement.report import figures, ratings_text, text_of
from ecat.annotate.agreement.sources import Compared, agree, reasons

__all__ = [
    "Agreement",
    "Columns",
    "Compared",
    "Disagreement",
    "agree",
    "cohen_kappa",
    "confusion",
    "disagreements",
    "figures",
    "fleiss_kappa",
    "krippendorff_alpha",
    "patterns_of",
    "rated_figures",
    "ratings_text",
    "reasons",
    "text_of",
]
