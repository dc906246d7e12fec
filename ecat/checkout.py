"""The checkout that ecat runs from: what is generated from the code lies beside it there, and only there."""

from __future__ import annotations

from pathlib import Path

from ecat.errors import UsageError

ROOT = Path(__file__).resolve().parents[1]


def checkout_folder(name: str) -> Path:
    """The folder ``name`` of the checkout.

    Raises
    ------
    UsageError : ecat runs from an installed package, which has none.
    """
    if not (ROOT / "pyproject.toml").is_file():
        raise UsageError(
            f"cannot write {name}/",
            where=f"{ROOT}: not a checkout of ecat but an installed package",
            fix="run it in a checkout, where `make demo` has installed ecat",
        )
    return ROOT / name
