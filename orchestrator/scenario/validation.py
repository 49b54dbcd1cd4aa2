"""Validate plain data against a type and say what is wrong, where, in Hedgehop's words.

Data are validated as JSON and strictly: a list may become a tuple and a text a path, but a text
never becomes a number, nor does ``true``.
"""

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, TypeVar, cast

from pydantic import TypeAdapter, ValidationError

from orchestrator.errors import nearest
from orchestrator.scenario.marks import Fault, KeyPath, Node, dotted
from orchestrator.scenario.wording import Schema, below, choices, expected, keys, show

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

T = TypeVar("T")

WHAT = {  # pydantic's name of an error: ours; all others are of a wrong type
    "missing": "missing",
    "extra_forbidden": "unknown key",
    "literal_error": "not a choice",
    "too_short": "wrong number of items",
    "too_long": "wrong number of items",
    "string_too_short": "empty",
    "string_pattern_mismatch": "malformed",
    "finite_number": "not finite",
    "greater_than": "out of range",
    "greater_than_equal": "out of range",
    "less_than": "out of range",
    "less_than_equal": "out of range",
    "multiple_of": "out of range",
}


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
        return adapter.validate_json(json.dumps(data), context=dict(context or {}))
    except ValidationError as error:
        details = error.errors(include_url=False)
    found: dict[KeyPath, Fault] = {}  # the branches of a union fail at the same place
    meant: set[KeyPath] = set()  # by a misspelt key: not told as missing too
    missing: set[KeyPath] = set()
    for detail in details:
        fault, instead = _fault(detail, adapter.json_schema(), data, root, path)
        found.setdefault(fault.path, fault)
        meant.update(instead)
        if detail["type"] == "missing":
            missing.add(fault.path)
    faults += [fault for place, fault in found.items() if place not in meant & missing]
    return None


def _fault(
    detail: "ErrorDetails", schema: Schema, data: object, root: Node, path: KeyPath
) -> tuple[Fault, list[KeyPath]]:
    """Return one of pydantic's errors as a fault, and the keys that may have been meant."""
    kind, loc = detail["type"], detail["loc"]
    if kind == "missing" and isinstance(loc[-1], int):
        kind, loc = "too_short", loc[:-1]
    if kind == "value_error":
        where, _, schema_there = _descend(loc, data, schema)
        message = detail["msg"].removeprefix("Value error, ")
        key, colon, what = message.partition(": ")
        if colon and key in keys(schema_there, schema):  # a dataclass names one of its fields
            where, message = (*where, key), what
        full = (*path, *where)
        return Fault(root.place(full), f"{dotted(full)}: {message}", full), []
    if kind in ("missing", "extra_forbidden"):
        around, _, below_it = _descend(loc[:-1], data, schema)
        full = (*path, *around, loc[-1])
        if kind == "missing":
            wanted = expected(below(below_it, loc[-1], schema), schema, loc[-1])
            return Fault(root.place(full), f"{dotted(full)}: missing, expected {wanted}", full), []
        known = keys(below_it, schema)
        near = nearest(str(loc[-1]), list(known))
        what = f"unknown key, got {loc[-1]!r}{near or f', expected {choices(known)}'}"
        meant = [(*full[:-1], name) for name in known if repr(name) in near]
        return Fault(root.place_of_key(full), f"{dotted(full)}: {what}", full), meant
    if loc[-1:] == ("[key]",):
        full = (*path, *loc[:-1])
        what = f"malformed name, got {loc[-2]!r}, expected letters, digits and '_'"
        return Fault(root.place_of_key(full), f"{dotted(full)}: {what}", full), []
    where, value, schema_there = _descend(loc, data, schema)
    full = (*path, *where)
    key = full[-1] if full else ""
    wanted = expected(schema_there, schema, key)
    near = nearest(value, schema_there.get("enum", ())) if isinstance(value, str) else ""
    wrong = "empty" if value in ({}, []) else WHAT.get(kind, "wrong type")
    what = f"{wrong}, got {show(value, key)}, expected {wanted}{near}"
    return Fault(root.place(full), f"{dotted(full)}: {what}", full), []


def _descend(loc: KeyPath, data: object, root: Schema) -> tuple[KeyPath, object, Schema]:
    """Return the path of an error in the data, the value there, and what the schema says of it.

    pydantic's own parts of ``loc``, such as a union's branches, are not keys and are left out.
    """
    where: list[str | int] = []
    schema = root
    for part in loc:
        if isinstance(data, Mapping) and part in data:
            data = cast(Mapping[str | int, object], data)[part]
        elif (
            isinstance(data, list)
            and isinstance(part, int)
            and part < len(cast(list[object], data))
        ):
            data = cast(list[object], data)[part]
        else:
            continue
        where.append(part)
        schema = below(schema, part, root)
    return tuple(where), data, schema
