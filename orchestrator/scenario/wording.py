"""Say in words what a JSON Schema expects at some place, and show what was found there."""

import json
from collections.abc import Iterable, Mapping
from typing import Any, cast

Schema = Mapping[str, Any]

UNITS = {  # of keys by suffix; the first that fits
    "_per_s": "1/s", "_mps2": "m/s2", "_radps": "rad/s", "_mps": "m/s", "_deg": "deg",
    "_rad": "rad", "_kg": "kg", "_kb": "kB", "_hz": "Hz", "_ms": "ms", "_G": "G", "_m": "m", "_s": "s",
}  # fmt: skip
BOUNDS = {
    "minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<",
}  # fmt: skip
PLAIN = {"boolean": "true or false", "object": "a mapping", "null": "null"}


def unit_of(key: str | int) -> str | None:
    """Return the unit that a key's suffix names."""
    return next((unit for suffix, unit in UNITS.items() if str(key).endswith(suffix)), None)


def show(value: object, key: str | int = "") -> str:
    """Return a value as messages show it, shortened; a number with the unit that its key names."""
    text = repr(value) if isinstance(value, str) else json.dumps(value)
    if isinstance(value, float | int) and not isinstance(value, bool) and unit_of(key):
        text += f" {unit_of(key)}"
    return text if len(text) <= 60 else f"{text[:56]} ..."


def choices(values: Iterable[object]) -> str:
    """Return ``one of 'a', 'b'``, or the only choice."""
    listed = [show(value) for value in values]
    return listed[0] if len(listed) == 1 else f"one of {', '.join(listed)}"


def expected(schema: Schema, root: Schema, key: str | int = "") -> str:
    """Return what a schema inside ``root`` expects, with the unit that the key names."""
    return " or ".join(dict.fromkeys(_words(one, key) for one in branches(schema, root)))


def _words(schema: Schema, key: str | int) -> str:
    if "const" in schema or "enum" in schema:
        return choices(schema.get("enum", [schema.get("const")]))
    kind = schema.get("type")
    if kind in ("number", "integer"):
        words = "a whole number" if kind == "integer" else "a number"
        unit = f" {unit}" if (unit := unit_of(key)) else ""
        bounds = [
            f"{sign} {schema[name]:g}{unit}" for name, sign in BOUNDS.items() if name in schema
        ]
        return f"{words} {' and '.join(bounds)}" if bounds else words + (unit and f" in{unit}")
    if kind == "array":
        least, most = schema.get("minItems", 0), schema.get("maxItems")
        if most is not None:
            return f"a list of {most}" if least == most else f"a list of {least} to {most}"
        return f"a list of {least} or more" if least else "a list"
    if kind == "object" and "properties" in schema:
        return f"a mapping of {', '.join(schema['properties'])}"
    if kind == "string" and "examples" in schema:
        return f"text like {schema['examples'][0]!r}"
    return PLAIN.get(str(kind), "a file name" if schema.get("format") == "path" else "text")


def branches(schema: Schema, root: Schema) -> list[Schema]:
    """Return the alternatives of a schema, with references to ``root`` followed."""
    if "$ref" in schema:
        return branches(root["$defs"][schema["$ref"].rpartition("/")[2]], root)
    if "anyOf" in schema:
        return [leaf for one in schema["anyOf"] for leaf in branches(one, root)]
    return [schema]


def keys(schema: Schema, root: Schema) -> Schema:
    """Return the keys that a schema names, with what each expects."""
    return {
        name: below
        for one in branches(schema, root)
        for name, below in one.get("properties", {}).items()
    }


def below(schema: Schema, part: str | int, root: Schema) -> Schema:
    """Return the schema of one member or item."""
    for one in branches(schema, root):
        if isinstance(part, int) and part < len(one.get("prefixItems", ())):
            return one["prefixItems"][part]
        if part in one.get("properties", ()):
            return one["properties"][part]
        others = (one.get("items"), one.get("additionalProperties"))
        for other in (*others, *one.get("patternProperties", {}).values()):
            if isinstance(other, Mapping):
                return cast(Schema, other)
    return {}
