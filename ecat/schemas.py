"""``schemas/``: what is generated from the model and the tables.  ``python -m ecat.schemas`` writes it anew."""

from __future__ import annotations

import json
import sys

from ecat.checkout import checkout_folder
from ecat.errors import EcatError
from ecat.store import manifest_schema, project_schema
from ecat.store.xsd import annotation_xsd
from ecat.tables import TABLES


def generated() -> dict[str, str]:
    """Every generated file: path inside ``schemas/`` and its content."""
    files = {
        "annotation.xsd": annotation_xsd(),
        "session.schema.json": _json(manifest_schema()),
        "project.schema.json": _json(project_schema()),
    }
    return files | {f"tables/{name}.json": _json(schema.to_dict()) for name, schema in TABLES.items()}


def _json(data: object) -> str:
    return json.dumps(data, indent=2, ensure_ascii=False) + "\n"


def main() -> None:
    """Write ``schemas/``.

    Raises
    ------
    UsageError : there is no checkout to write into.
    """
    folder = checkout_folder("schemas")
    for name, text in generated().items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        sys.stdout.write(f"{path.relative_to(folder.parent)}\n")


if __name__ == "__main__":
    try:
        main()
    except EcatError as failed:
        sys.exit(f"ecat: {failed}")
