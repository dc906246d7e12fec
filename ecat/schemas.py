"""``schemas/``: what is generated from the model and the tables.  ``python -m ecat.schemas`` writes it anew."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from ecat.store import manifest_schema, project_schema
from ecat.store.xsd import annotation_xsd
from ecat.tables import TABLES

FOLDER = Path(__file__).resolve().parents[1] / "schemas"


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
    """Write ``schemas/``."""
    for name, text in generated().items():
        path = FOLDER / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        sys.stdout.write(f"{path.relative_to(FOLDER.parent)}\n")


if __name__ == "__main__":
    main()
