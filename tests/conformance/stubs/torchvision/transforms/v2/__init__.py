"""Names that lerobot's augmentations derive from; none of them is used here."""

from __future__ import annotations

from . import functional

__all__ = ["ColorJitter", "Compose", "Identity", "RandomAffine", "Transform", "functional"]


class Transform:
    """Never called."""


class ColorJitter(Transform):
    """Never called."""


class Compose(Transform):
    """Never called."""


class Identity(Transform):
    """Never called."""


class RandomAffine(Transform):
    """Never called."""
