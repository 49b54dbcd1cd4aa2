"""YAML text to marked plain data: what is read, what is refused, what lies on top of what."""

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orchestrator.scenario.layers import MAX_EXTENDS, override, read
from orchestrator.scenario.marks import Fault, Mark, Origins
from orchestrator.scenario.yaml_source import MAX_NESTING, dump, parse


def parsed(text):
    """Return the plain data and the faults of a text."""
    faults: list[Fault] = []
    node = parse(text, Mark("a.yaml", 1), faults)
    return None if node is None else node.plain(), [str(fault).split("\n")[0] for fault in faults]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e3", 1000.0),
        ("1e-3", 0.001),
        ("-.5", -0.5),
        ("012", 12),
        ("+7", 7),
        ("1:30", "1:30"),
        ("0x10", "0x10"),
        ("1_000", "1_000"),
        ("no", "no"),
        ("on", "on"),
        ("True", "True"),
        ("true", True),
        ("2001-01-01", "2001-01-01"),
        ("~", None),
        ("", None),
        ("-.inf", -math.inf),
        ("'1e3'", "1e3"),
        ("=", "="),
    ],
)
def test_scalars_follow_the_yaml_1_2_core_schema(text, value):
    """Numbers are decimal, booleans are true and false, everything else is text."""
    data, faults = parsed(f"a: {text}")
    assert data == {"a": value}
    assert type(data["a"]) is type(value)
    assert faults == []


plain = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=12,
)


@given(st.dictionaries(st.text(), plain, max_size=5))
def test_what_is_dumped_is_read_back(data):
    """Load after dump is the identity on plain data."""
    assert parsed(dump(data)) == (data, [])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "a: 1\nb: 2\na: 3",
            "a.yaml:3:1: a: key given twice, got a.yaml:1:1 and a.yaml:3:1, expected one",
        ),
        (
            "x:\n  a: {b: 1, b: 2}",
            "a.yaml:2:13: x.a.b: key given twice, got a.yaml:2:7 and a.yaml:2:13, expected one",
        ),
        ("1: a", "a.yaml:1:1: scenario: key is not text, got 1, expected a name"),
        (
            "a: !!python/name:os.system x",
            (
                "a.yaml:1:4: a: cannot be read as plain data, "
                "got tag 'tag:yaml.org,2002:python/name:os.system'"
            ),
        ),
        (
            "a: !!int x",
            "a.yaml:1:4: a: cannot be read as plain data, got tag 'tag:yaml.org,2002:int'",
        ),
        ("a: [1,", "a.yaml:1:7: YAML: while parsing a flow node, "),
        ("a: *b", "a.yaml:1:4: YAML: found undefined alias 'b'"),
        ("a: 1\n---\nb: 2", "a.yaml:2:1: YAML: expected a single document in the stream, "),
        ("a:\n  - \x07", "a.yaml:2:1: YAML: character '\\x07' is not allowed"),
        ("a: 1\n<<: 2", "a.yaml:2:1: scenario: << takes mappings"),
        ("a: &a [*a]", "a.yaml:1:4: YAML: too large, expected at most 20000 values, 50 deep"),
        ("[" * 600, "a.yaml:1:1: YAML: nested too deep"),
        ("a: " + "[" * (MAX_NESTING + 1) + "]" * (MAX_NESTING + 1), "YAML: too large, "),
    ],
)
def test_what_is_not_plain_data_is_refused_where_it_stands(text, message):
    """Repeated keys, tags, cycles and broken syntax are faults with line and column."""
    _, faults = parsed(text)
    assert len(faults) == 1
    assert message in faults[0]


def test_aliases_cannot_multiply_without_bound():
    """Nine lines that stand for a billion values are refused."""
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 9)]
    _, faults = parsed("\n".join(lines))
    assert "too large" in faults[0]


def test_merge_keys_lie_below_a_mappings_own():
    """What `<<` merges is overruled by the mapping itself, the first of several by none after."""
    text = "a: &a {x: 1, y: 1}\nb: &b {y: 2, z: 2}\nc: {<<: [*a, *b], x: 3}"
    assert parsed(text)[0]["c"] == {"x": 3, "y": 1, "z": 2}


def test_every_value_knows_its_place():
    """Positions are those of the values, in every file that has a part in them."""
    faults = []
    node = parse("a:\n  b: [10, {c: x}]\n", Mark("a.yaml", 1), faults)
    origins = Origins(node)
    assert origins["a", "b", 0] == "a.yaml:2:7"
    assert origins["a", "b", 1, "c"] == "a.yaml:2:15"
    assert len(list(origins)) == len(origins) == 6
    assert str(node.place_of_key(("a", "b"))) == "a.yaml:2:3"
    assert str(node.place(("a", "nothing"))) == "a.yaml:1:1"


def test_a_fault_shows_the_line_with_a_caret():
    """Tabs stay tabs, so that the caret stands below what it points at."""
    fault = Fault(Mark("a.yaml", 12, 5, 2, "\tab: no"), "ab: wrong")
    assert str(fault) == "a.yaml:12:5: ab: wrong\n    12 | \tab: no\n       | \t   ^^"


@pytest.fixture
def files(tmp_path, monkeypatch):
    """Return a function that writes files into the current folder."""
    monkeypatch.chdir(tmp_path)

    def write(**texts):
        for name, text in texts.items():
            Path(f"{name}.yaml").write_text(text)

    return write


def layered(name, *overrides):
    """Return a file's plain data with overrides, its faults, and its origins."""
    faults: list[Fault] = []
    node = read(Path(name), faults)
    for number, text in enumerate(overrides, start=1):
        node = override(node, text, number, lambda path: path[-1] == "new", faults)
    return node.plain() if node else None, [str(f).split("\n")[0] for f in faults], node


def test_extending_merges_mappings_and_replaces_everything_else(files):
    """Lists replace, null removes what a parent wrote, later parents lie on earlier ones."""
    files(
        one="a: {x: 1, y: 1}\nlist: [1, 2]\ngone: 1\nkept: 1",
        two="a: {y: 2, z: 2}\ngone: 2",
        top="extends: [one.yaml, two.yaml]\na: {z: 3}\nlist: [3]\ngone: null\nown: null",
    )
    data, faults, node = layered("top.yaml")
    assert faults == []
    assert data == {"a": {"x": 1, "y": 2, "z": 3}, "list": [3], "kept": 1, "own": None}
    assert Origins(node)["a", "x"] == "one.yaml:1:8"
    assert Origins(node)["a", "y"] == "two.yaml:1:8"
    assert Origins(node)["a", "z"] == "top.yaml:2:8"


def test_parents_are_found_relative_to_the_file_that_names_them(files, tmp_path):
    """A parent's own parent lies relative to the parent."""
    (tmp_path / "base").mkdir()
    (tmp_path / "base" / "inner.yaml").write_text("a: 1")
    (tmp_path / "base" / "outer.yaml").write_text("extends: inner.yaml\nb: 2")
    files(top="extends: base/outer.yaml\nc: 3")
    assert layered("top.yaml")[0] == {"a": 1, "b": 2, "c": 3}


def test_a_cycle_of_files_is_shown_as_a_chain(files):
    """Files that extend each other are refused at the key that closes the cycle."""
    files(a="extends: b.yaml", b="extends: c.yaml", c="extends: b.yaml")
    assert layered("a.yaml")[1] == [
        "c.yaml:1:10: extends: a cycle, got b.yaml -> c.yaml -> b.yaml, expected files that end"
    ]


def test_files_lie_on_each_other_to_a_limit(files):
    """Nine files deep is refused, eight is not."""
    texts = {f"f{i}": f"extends: f{i + 1}.yaml\nv{i}: {i}" for i in range(MAX_EXTENDS + 1)}
    files(**texts, **{f"f{MAX_EXTENDS + 1}": "a: 1"})
    assert layered("f1.yaml")[1] == []
    assert layered("f0.yaml")[1] == [
        "f8.yaml:1:10: extends: too deep, got 9 files on top of each other, expected 8"
    ]


def test_wrong_parents_are_faults_of_the_key(files):
    """A missing parent comes with the nearest file; anything but a name is refused."""
    files(noe_base="a: 1", high="extends: [noe_bas.yaml, 3]")
    missing, other = layered("high.yaml")[1]
    assert missing.startswith(
        "high.yaml:1:11: extends: file not found, got 'noe_bas.yaml', expected a file relative to "
        "high.yaml or an installed scenario, did you mean 'noe_base.yaml'"
    )
    assert other == (
        "high.yaml:1:25: extends: not a file name, got 3, expected one or a list of them"
    )


def test_a_file_that_is_not_utf8_is_a_fault(tmp_path, monkeypatch):
    """The fault names the line of the first wrong byte."""
    monkeypatch.chdir(tmp_path)
    Path("a.yaml").write_bytes(b"a: 1\nb: \xff")
    assert layered("a.yaml")[1] == ["a.yaml:2:1: file: not UTF-8 text"]


def test_overrides_change_single_values(files):
    """Values are YAML; list items go by index; an origin is the override's number."""
    files(a="x: {y: 1, z: 1}\nl: [{a: 1}, 2]")
    data, faults, node = layered(
        "a.yaml", "x.y=1e3", "l.0.a=[1, b]", "x.z=null", "x.more=a=b", "new.deep=3", "l.1="
    )
    assert faults == []
    assert data == {
        "x": {"y": 1000.0, "more": "a=b"},
        "l": [{"a": [1, "b"]}, None],
        "new": {"deep": 3},
    }
    assert Origins(node)["x", "y"] == "--set #1"
    assert Origins(node)["l", 0, "a", 1] == "--set #2"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x", "--set #1: x: not an override, expected path=value"),
        ("x..y=1", "--set #1: x..y=1: not an override, expected path=value"),
        ("xx.y=1", "--set #1: xx.y: no key 'xx' in the scenario, did you mean 'x'"),
        ("l.2.a=1", "--set #1: l.2.a: no item '2', expected 0 to 1"),
        ("l.a=1", "--set #1: l.a: no item 'a', expected 0 to 1"),
        ("x.y.z=1", "--set #1: x.y.z: nothing below 'x.y', which is 1"),
        ("x.y=[1", "--set #1: YAML: while parsing a flow sequence, "),
    ],
)
def test_an_override_that_leads_nowhere_is_a_fault(files, text, message):
    """The path is checked key by key, with the nearest name."""
    files(a="x: {y: 1}\nl: [1, 2]")
    data, faults, _ = layered("a.yaml", text)
    assert faults[0].startswith(message)
    assert data == {"x": {"y": 1}, "l": [1, 2]}
