"""Read YAML text as a tree of marked plain data.

The YAML is the 1.2 core schema without its surprises: ``1e3`` is a number, only ``true`` and
``false`` are booleans, ``012`` is twelve, ``1:30`` is text, a repeated key is an error, and no tag
makes anything but plain data.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

import yaml

from orchestrator.scenario.marks import Fault, KeyPath, Mark, Node, Scalar, dotted

BREAKS = "\r\n|[\n\r\x85\u2028\u2029]"  # where PyYAML counts lines
MAX_NESTING = 50
MAX_VALUES = 20_000  # aliases included: ten short lines of them can stand for a billion values

TAG = "tag:yaml.org,2002:"
NOTATION = {  # tag: how it is written, first letters; the first match decides
    "bool": ("true|false", "tf"),
    "null": ("~|null|", ["~", "n", ""]),
    "int": ("[-+]?[0-9]+", "-+0123456789"),
    "float": (
        r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?|[-+]?\.inf|\.nan",
        "-+.0123456789",
    ),
    "merge": ("<<", "<"),
}


class _Loader(yaml.SafeLoader):
    yaml_implicit_resolvers = {}  # noqa: RUF012  yaml's own convention, as in the next class


class _Dumper(yaml.SafeDumper):
    yaml_implicit_resolvers = {}  # noqa: RUF012

    def ignore_aliases(self, data: object) -> bool:  # noqa: ARG002
        """Write every value out."""
        return True

    def represent_str(self, data: str) -> yaml.ScalarNode:
        """Escape the line breaks that PyYAML would fold away."""
        style = '"' if re.search("[\x85\u2028\u2029]", data) else None
        return self.represent_scalar(TAG + "str", data, style=style)


_Dumper.add_representer(str, _Dumper.represent_str)
for _name, (_pattern, _first) in NOTATION.items():
    for _class in (_Loader, _Dumper):
        _class.add_implicit_resolver(TAG + _name, re.compile(f"^(?:{_pattern})$"), list(_first))


def parse(text: str, mark: Mark, faults: list[Fault]) -> Node | None:
    """Return the tree of one YAML text that begins at ``mark``.

    What is wrong with it is appended to ``faults``, everywhere in this module.
    """
    return _Parser(mark, re.split(BREAKS, text), faults).document(text)


def dump(data: Mapping[str, object]) -> str:
    """Return plain data as YAML text that this module reads back as the same data."""
    return yaml.dump(dict(data), Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=100)


@dataclass
class _Parser:
    """From PyYAML's nodes to ours; only scalars, lists and mappings with text keys pass."""

    start: Mark
    lines: list[str]
    faults: list[Fault]
    count: int = 0

    def document(self, text: str) -> Node | None:
        try:
            root = yaml.compose(text, Loader=_Loader)
            return None if root is None else self.node(root, ())
        except yaml.MarkedYAMLError as error:
            what = ", ".join(part for part in (error.context, error.problem) if part)
            at = error.problem_mark or error.context_mark
            mark = self.mark(at, at) if at else self.start
            hint = ", expected quotes around '${...}'" if ": ${" in mark.text else ""
            self.faults.append(Fault(mark, f"YAML: {what}{hint}"))
        except yaml.reader.ReaderError as error:
            line = text.count("\n", 0, error.position) + 1 if self.start.line else 0
            what = f"YAML: character {text[error.position]!r} is not allowed"
            self.faults.append(Fault(replace(self.start, line=line), what))
        except RecursionError:
            self.faults.append(Fault(self.start, "YAML: nested too deep"))
        return None

    def mark(self, start: yaml.Mark, end: yaml.Mark) -> Mark:
        if not self.start.line:  # an override, which shows all of itself
            column = self.start.column + start.column
            return replace(self.start, column=column, width=max(end.column - start.column, 1))
        line = self.lines[start.line] if start.line < len(self.lines) else ""
        stop = end.column if end.line == start.line else len(line.rstrip())
        width = max(stop - start.column, 1)
        return Mark(self.start.source, start.line + 1, start.column + 1, width, line)

    def node(self, node: yaml.Node, path: KeyPath) -> Node:
        mark = self.mark(node.start_mark, node.end_mark)
        self.count += 1
        if self.count > MAX_VALUES or len(path) > MAX_NESTING:
            what = f"expected at most {MAX_VALUES} values, {MAX_NESTING} deep"
            raise yaml.MarkedYAMLError(problem=f"too large, {what}", problem_mark=node.start_mark)
        if isinstance(node, yaml.MappingNode) and node.tag == TAG + "map":
            return Node(self.members(node, path), mark)
        if isinstance(node, yaml.SequenceNode) and node.tag == TAG + "seq":
            return Node([self.node(item, (*path, i)) for i, item in enumerate(node.value)], mark)
        if isinstance(node, yaml.ScalarNode):
            try:
                return Node(_scalar(node.tag.removeprefix(TAG), node.value), mark)
            except ValueError:
                pass
        what = f"cannot be read as plain data, got tag {node.tag!r}"
        self.faults.append(Fault(mark, f"{dotted(path)}: {what}", path))
        return Node(None, mark)

    def members(self, node: yaml.MappingNode, path: KeyPath) -> dict[str, Node]:
        """Return a mapping's members; what ``<<`` merges in comes below its own."""
        own: dict[str, Node] = {}
        merged: dict[str, Node] = {}
        for key, value in node.value:
            name, mark = key.value, self.mark(key.start_mark, key.end_mark)
            if key.tag == TAG + "merge":
                maps = value.value if isinstance(value, yaml.SequenceNode) else [value]
                for one in map(partial(self.node, path=path), maps):
                    if isinstance(one.value, dict):
                        merged = {**one.value, **merged}
                    else:
                        self.faults.append(Fault(mark, f"{dotted(path)}: << takes mappings", path))
            elif key.tag != TAG + "str":
                what = f"key is not text, got {name if isinstance(name, str) else key.id}"
                self.faults.append(Fault(mark, f"{dotted(path)}: {what}, expected a name", path))
            elif name in own:
                what = f"key given twice, got {own[name].key} and {mark}, expected one"
                self.faults.append(Fault(mark, f"{dotted((*path, name))}: {what}", (*path, name)))
            else:
                own[name] = replace(self.node(value, (*path, name)), key=mark)
        return {**merged, **own}


def _scalar(tag: str, text: str) -> Scalar:
    """Return the value of a scalar; ValueError if its tag does not fit or is not plain data."""
    if tag == "str":
        return text
    if not re.fullmatch(NOTATION.get(tag, ("(?!)",))[0], text):
        raise ValueError(text)
    if tag == "bool":
        return text == "true"
    if tag == "int":
        return int(text)
    return float(text.replace(".inf", "inf").replace(".nan", "nan")) if tag == "float" else None
