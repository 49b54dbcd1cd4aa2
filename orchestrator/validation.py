"""Validate plain data against a pydantic type and say what is wrong in Hedgehop's words.

Data are validated as JSON and strictly: a list may become a tuple and a text a path, but a text
never becomes a number, nor ``true`` one.
"""

import json
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar, cast

from pydantic import TypeAdapter, ValidationError

from orchestrator.errors import nearest
from orchestrator.marks import Fault, KeyPath, Node, dotted

T = TypeVar("T")
Schema = Mapping[str, Any]

UNITS = {  # the longest suffix that fits
    "_per_s": "1/s", "_mps2": "m/s2", "_radps": "rad/s", "_mps": "m/s", "_deg": "deg",
    "_rad": "rad", "_kg": "kg", "_hz": "Hz", "_ms": "ms", "_G": "G", "_m": "m", "_s": "s",
}  # fmt: skip
WHAT = {
    "missing": "missing",
    "extra_forbidden": "unknown key",
    "literal_error": "not a choice",
    "too_short": "wrong number of items",
    "too_long": "wrong number of items",
    "string_pattern_mismatch": "malformed",
    "finite_number": "not finite",
    **dict.fromkeys(
        ("greater_than", "greater_than_equal", "less_than", "less_than_equal", "multiple_of"),
        "out of range",
    ),
}


def unit_of(key: str | int) -> str | None:
    """Return the unit that a key's suffix names."""
    return next((unit for end, unit in UNITS.items() if str(key).endswith(end)), None)


def validate(
    adapter: TypeAdapter[T],
    data: object,
    faults: list[Fault],
    root: Node,
    path: KeyPath = (),
    context: Mapping[str, object] | None = None,
) -> T | None:
    """Return ``data``, which stands at ``path`` of ``root``, as the adapter's type.

    What is wrong is appended to ``faults``, and None returned.
    """
    try:
        return adapter.validate_json(json.dumps(data), strict=True, context=dict(context or {}))
    except ValidationError as error:
        faults += _faults(error, adapter.json_schema(), data, root, path)
        return None


def _faults(
    error: ValidationError, schema: Schema, data: object, root: Node, path: KeyPath
) -> Iterable[Fault]:
    """Return one fault per place; the branches of a union fail together."""
    told: dict[KeyPath, Fault] = {}
    meant: set[KeyPath] = set()  # missing keys that a misspelt one stands for
    for detail in error.errors(include_url=False):
        kind = detail["type"]
        where, found, expected = _descend(detail["loc"], data, schema, kind)
        full = (*path, *where)
        place = root.place(full)
        if kind == "extra_forbidden":
            names = list(expected.get("properties", {}))
            near = nearest(str(where[-1]), names)
            meant |= {(*full[:-1], name) for name in names if repr(name) in near}
            what = f"got {where[-1]!r}, expected {_choices(names)}{near}"
            above = _node(root, full)
            place = above.key or place if above else place
        elif kind == "missing":
            what = f"expected {describe(expected, schema, where[-1])}"
        elif kind == "value_error":
            what = detail["msg"].removeprefix("Value error, ")
            told.setdefault(full, Fault(place, f"{dotted(full)}: {what}", full))
            continue
        else:
            what = f"got {show(found)}, expected {describe(expected, schema, where[-1])}"
            if isinstance(found, str):
                what += nearest(found, [str(one) for one in expected.get("enum", ())])
        message = f"{dotted(full)}: {WHAT.get(kind, 'wrong type')}, {what}"
        told.setdefault(full, Fault(place, message, full))
    return [fault for full, fault in told.items() if full not in meant]


def _node(root: Node, path: KeyPath) -> Node | None:
    node: Node | None = root
    for part in path:
        node = node.below(part) if node else None
    return node


def _descend(loc: KeyPath, data: object, root: Schema, kind: str) -> tuple[KeyPath, object, Schema]:
    """Return the path of an error in the data, the value there, and what the schema says of it.

    pydantic's own parts of ``loc``, such as a union's branches, are not keys and are left out. An
    unknown key comes with the schema of the mapping around it.
    """
    where: list[str | int] = []
    schema = root
    for number, part in enumerate(loc):
        is_last_key = number == len(loc) - 1 and kind in ("missing", "extra_forbidden")
        if isinstance(data, Mapping) and part in data:
            data = cast(Mapping[str, object], data)[str(part)]
        elif isinstance(data, list) and isinstance(part, int) and part < len(data):
            data = cast(list[object], data)[part]
        elif not is_last_key:
            continue
        where.append(part)
        if kind != "extra_forbidden" or not is_last_key:
            schema = _below(schema, part, root)
    return tuple(where), data, _mapping(schema, root) if kind == "extra_forbidden" else schema


def _resolve(schema: Schema, root: Schema) -> Schema:
    if "$ref" in schema:
        return _resolve(root["$defs"][schema["$ref"].rpartition("/")[2]], root)
    return schema


def _branches(schema: Schema, root: Schema) -> list[Schema]:
    schema = _resolve(schema, root)
    return (
        [leaf for one in schema["anyOf"] for leaf in _branches(one, root)]
        if "anyOf" in schema
        else [schema]
    )


def _mapping(schema: Schema, root: Schema) -> Schema:
    return next((one for one in _branches(schema, root) if "properties" in one), {})


def _below(schema: Schema, part: str | int, root: Schema) -> Schema:
    """Return the schema of one member or item."""
    for one in _branches(schema, root):
        if isinstance(part, int) and part < len(one.get("prefixItems", ())):
            return one["prefixItems"][part]
        for key in ("items",) if isinstance(part, int) else ("properties", "additionalProperties"):
            below = one.get(key)
            if key == "properties" and below and part in below:
                return below[part]
            if key != "properties" and isinstance(below, Mapping):
                return cast(Schema, below)
    return {}


def describe(schema: Schema, root: Schema, key: str | int = "") -> str:
    """Return what a schema expects, in words, with the unit that the key names."""
    return " or ".join(dict.fromkeys(_words(one, key) for one in _branches(schema, root)))


def _words(schema: Schema, key: str | int) -> str:
    if "const" in schema or "enum" in schema:
        return _choices(schema.get("enum", [schema.get("const")]))
    kind = schema.get("type")
    if kind in ("number", "integer"):
        unit = f" {unit}" if (unit := unit_of(key)) else ""
        words = "a whole number" if kind == "integer" else "a number"
        bounds = [
            f"{sign} {schema[name]:g}{unit}"
            for name, sign in (
                ("minimum", ">="), ("exclusiveMinimum", ">"),
                ("maximum", "<="), ("exclusiveMaximum", "<"),
            )
            if name in schema
        ]  # fmt: skip
        return f"{words} {' and '.join(bounds)}" if bounds else words + (unit and f" in{unit}")
    if kind == "array":
        counts = [schema[name] for name in ("minItems", "maxItems") if name in schema]
        return f"a list of {' to '.join(map(str, dict.fromkeys(counts)))}" if counts else "a list"
    plain = {"boolean": "true or false", "object": "a mapping", "null": "null"}
    return plain.get(str(kind), "a file name" if schema.get("format") == "path" else "text")


def _choices(values: Iterable[object]) -> str:
    listed = [show(value) for value in values]
    return listed[0] if len(listed) == 1 else f"one of {', '.join(listed)}"


def show(value: object) -> str:
    """Return a value as messages show it, shortened."""
    text = repr(value) if isinstance(value, str) else json.dumps(value)
    return text if len(text) <= 60 else f"{text[:56]} ..."
