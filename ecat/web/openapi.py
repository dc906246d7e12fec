"""``python -m ecat.web.openapi`` prints ``web/openapi.json``, which the page's types are checked against."""

from __future__ import annotations

import json
import sys
from typing import Any

from pydantic import TypeAdapter

from ecat.annotate import OPERATIONS, Operation
from ecat.web.app import application

_SHAPES = "#/components/schemas/"


def description() -> dict[str, Any]:
    """The server's routes and shapes, and every operation, as OpenAPI."""
    described = application().openapi()
    shapes = described["components"]["schemas"]
    names = [_add_operation(shapes, name, kind) for name, kind in OPERATIONS.items()]
    refs = {name: f"{_SHAPES}{shape}" for name, shape in zip(OPERATIONS, names, strict=True)}
    shapes["Operation"] = {
        "oneOf": [{"$ref": ref} for ref in refs.values()],
        "discriminator": {"propertyName": "op", "mapping": refs},
    }
    shapes["Edit"]["properties"]["operations"]["items"] = {"$ref": f"{_SHAPES}Operation"}
    # a coordinate that is missing
    shapes["KeyFrame"]["properties"]["coordinates"]["items"] = {"type": ["number", "null"]}
    return described


def _add_operation(shapes: dict[str, Any], name: str, kind: type[Operation]) -> str:
    """Add the shape of an operation to ``shapes``, and those it is made of; its own name among them."""
    shape = TypeAdapter(kind).json_schema(ref_template=_SHAPES + "{model}")
    for inner, schema in shape.pop("$defs", {}).items():
        shapes.setdefault(inner, schema)
    shape["properties"] = {"op": {"const": name, "type": "string"}, **shape.get("properties", {})}
    shape["required"] = ["op", *shape.get("required", [])]
    shape["additionalProperties"] = False
    shapes[kind.__name__] = shape
    return kind.__name__


def document() -> str:
    """The description as it is kept: sorted, so that a difference is a change."""
    return json.dumps(description(), indent=1, sort_keys=True, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    sys.stdout.write(document())
