"""Networks that recognise actions: those of the thesis, and one that sees raw joints and markers.

Importing this package needs PyTorch; nothing outside of it does.
"""

from __future__ import annotations

import importlib.util

from ecat.errors import MissingExtraError

if importlib.util.find_spec("torch") is None:
    raise MissingExtraError(
        "cannot use a neural recogniser", where="PyTorch is not installed", fix="pip install 'ecat[learn]'"
    )

__all__: list[str] = []
