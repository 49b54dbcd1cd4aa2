"""Put scenario files on top of each other, and overrides on top of them.

``extends: base.yaml`` (or a list) starts from other files, beside this one or installed: mappings
merge, everything else replaces, ``null`` removes what a parent wrote. An override
``a.b.c=value``, its value read as YAML, is merged last, as if it were one more file.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from stat import S_ISDIR, S_ISREG

from orchestrator.errors import nearest
from orchestrator.scenario.marks import Fault, KeyPath, Mark, Node
from orchestrator.scenario.yaml_source import parse

MAX_EXTENDS = 8


def installed() -> Path:
    """Return the folder of the scenarios that came with the installation."""
    packages = Path(__file__).parents[1]
    inside = packages / "scenarios"  # in a wheel
    return inside if inside.is_dir() else packages.parent / "scenarios"


def read(file: Path, faults: list[Fault], chain: tuple[Path, ...] = ()) -> Node | None:
    """Return the tree of a file merged onto those that it extends; None if one is not to be had.

    ``chain`` is how the file was reached. Messages show files as they are given here.
    """
    source = Mark(str(file), 1)
    try:
        text = file.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        faults.append(Fault(replace(source, line=line), "file: not UTF-8 text"))
        return None
    except IsADirectoryError:
        faults.append(Fault(Mark(str(file)), "is a folder, expected a scenario file"))
        return None
    except OSError as error:
        faults.append(Fault(Mark(str(file)), f"file: cannot be read, {error.strerror}"))
        return None
    return read_text(text, file, faults, chain)


def read_text(
    text: str, file: Path, faults: list[Fault], chain: tuple[Path, ...] = ()
) -> Node | None:
    """Return the tree of a text that stands for a file: see :func:`read`."""
    node = parse(text, Mark(str(file), 1), faults)
    if node is None or not isinstance(node.value, dict) or "extends" not in node.value:
        return node
    members = dict(node.value)
    base: Node | None = None
    is_whole = True
    for parent in _parents(members.pop("extends"), (*chain, file), faults):
        before = len(faults)
        other = read(parent, faults, (*chain, file)) if parent else None
        base = merge(base, other) if base and other else other or base
        is_whole &= parent is not None and (other is not None or len(faults) == before)
    if not is_whole:
        return None
    child = replace(node, value=members)
    return merge(base, child) if base else child


def _parents(extends: Node, chain: tuple[Path, ...], faults: list[Fault]) -> Iterator[Path | None]:
    """Yield the files to extend; None in place of one that cannot be, which is reported."""
    for node in extends.value if isinstance(extends.value, list) else [extends]:
        name = node.plain()
        folder = chain[-1].parent
        file = next(
            (one / str(name) for one in (folder, installed()) if S_ISREG(_mode(one / str(name)))),
            folder / str(name),
        )
        above = [link.resolve() for link in chain]
        if not isinstance(name, str):
            what = f"not a file name, got {name!r}, expected one or a list of them"
        elif not S_ISREG(_mode(file)):
            folders = [one for one in (file.parent, installed()) if S_ISDIR(_mode(one))]
            known = [one.name for each in folders for one in each.glob("*.y*ml")]
            where = f"a file relative to {chain[-1]} or an installed scenario"
            what = f"file not found, got {name!r}, expected {where}{nearest(file.name, known)}"
        elif file.resolve() in above:
            cycle = [*chain[above.index(file.resolve()) :], file]
            what = f"a cycle, got {' -> '.join(map(str, cycle))}, expected files that end"
        elif len(chain) > MAX_EXTENDS:
            what = f"too deep, got {len(chain)} files on top of each other, expected {MAX_EXTENDS}"
        else:
            yield file
            continue
        faults.append(Fault(node.mark, f"extends: {what}", ("extends",)))
        yield None


def _mode(path: Path) -> int:
    """Return what a path leads to, as ``stat`` says; 0 if to nothing, as names that cannot be do."""
    try:
        return path.stat().st_mode
    except (OSError, ValueError):
        return 0


def merge(base: Node, top: Node) -> Node:
    """Return ``top`` on ``base``: mappings merge, all else replaces, ``null`` removes."""
    if not (isinstance(base.value, dict) and isinstance(top.value, dict)):
        return top
    members = dict(base.value)
    for name, node in top.value.items():
        if name not in members:
            members[name] = node
        elif node.value is None:
            del members[name]
        else:
            members[name] = merge(members[name], node)
    return replace(top, value=members)


def override(
    root: Node, text: str, number: int, creates: Callable[[KeyPath], bool], faults: list[Fault]
) -> Node:
    """Return the tree with ``path=value`` merged into it, the ``number``-th override.

    The path's last key may be new; before it, only the mappings that ``creates`` allows.
    """
    path, equals, value = text.partition("=")
    mark = Mark(f"--set #{number}", width=max(len(text), 1), text=text)
    if not equals or not all(path.split(".")):
        faults.append(Fault(mark, f"{text}: not an override, expected path=value"))
        return root
    node = parse(value, replace(mark, column=len(path) + 2, width=1), faults)
    if node is None:
        node = Node(None, replace(mark, column=len(path) + 2, width=max(len(value), 1)))
        if value.strip():
            return root
    try:
        return _put(root, (), path.split("."), node, replace(mark, width=len(path)), creates)
    except KeyError as error:
        faults.append(Fault(replace(mark, width=len(path)), f"{path}: {error.args[0]}"))
        return root


def _put(
    root: Node,
    done: KeyPath,
    parts: list[str],
    value: Node,
    key: Mark,
    creates: Callable[[KeyPath], bool],
) -> Node:
    """Return ``root``, which stands at ``done``, with the value at the path ``parts`` below it."""
    part, rest = parts[0], parts[1:]
    if isinstance(root.value, list):
        if not part.isdecimal() or int(part) >= len(root.value):
            raise KeyError(f"no item {part!r}, expected 0 to {len(root.value) - 1}")
        index, items = int(part), list(root.value)
        below = items[index]
        items[index] = _put(below, (*done, index), rest, value, key, creates) if rest else value
        return replace(root, value=items)
    if not isinstance(root.value, dict):
        raise KeyError(f"nothing below {'.'.join(map(str, done))!r}, which is {root.plain()!r}")
    if not rest:
        return merge(root, replace(root, value={part: replace(value, key=key)}))
    if part in root.value:
        child = _put(root.value[part], (*done, part), rest, value, key, creates)
    elif creates((*done, part)):
        child = _put(Node({}, value.mark, key), (*done, part), rest, value, key, creates)
    else:
        raise KeyError(f"no key {part!r} in the scenario{nearest(part, list(root.value))}")
    return replace(root, value={**root.value, part: child})
