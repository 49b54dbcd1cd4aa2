"""What the documents tell people to type works."""

import re
import shlex
import sys
import tomllib
from pathlib import Path

import pytest

from orchestrator.assembly.discovery import GROUP
from orchestrator.assembly.unit_names import BASES, NAMED, PREFIXES
from orchestrator.command.app import status
from plant.variables import SUFFIX_UNITS

DOCS = Path(__file__).parents[1] / "docs"
PAGES = {  # and what kinds of blocks it has
    "swap.md": {"sh", "python"},
    "components.md": {"sh", "python", "yaml", "toml"},
}


def text(page):
    """Return a page."""
    return (DOCS / page).read_text(encoding="utf-8")


def blocks(page):
    """Return the language and the text of every block of a page."""
    return re.findall(r"```(\w+)\n(.*?)```", text(page), flags=re.DOTALL)


@pytest.fixture
def _own_modules(monkeypatch):
    """Forget what is imported from the folder of a page."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    before = set(sys.modules)
    yield
    for name in set(sys.modules) - before:
        if name.partition(".")[0] in ("rig", "notchy"):
            del sys.modules[name]


@pytest.mark.usefixtures("_own_modules")
@pytest.mark.parametrize("page", PAGES)
def test_every_command_ends_well(page, tmp_path, monkeypatch, capsys):
    """Every command of a page ends well, in its order, in one folder with the files of the page."""
    monkeypatch.chdir(tmp_path)
    for language, block in blocks(page):
        if language != "sh":
            file = Path(block.partition("\n")[0].removeprefix("# "))
            file.parent.mkdir(exist_ok=True)
            file.write_text(block, encoding="utf-8")
            continue
        for line in block.replace("\\\n", " ").splitlines():
            words = shlex.split(line)
            may_differ = words[-2:] == ["||", "true"]
            code = status(words[1:-2] if may_differ else words[1:])
            told = capsys.readouterr()
            assert code in ((0, 1) if may_differ else (0,)), f"{line}\n{told.out}{told.err}"


@pytest.mark.parametrize("page", PAGES)
def test_a_page_has_code_of_its_kinds(page):
    """A page is not empty for a reason that nobody notices, and no block is left out."""
    assert {language for language, _ in blocks(page)} == PAGES[page]


def test_the_entry_point_is_one_that_is_found():
    """The group in the page's pyproject.toml is the one that is searched, its value the class."""
    (block,) = [block for language, block in blocks("components.md") if language == "toml"]
    assert tomllib.loads(block)["project"]["entry-points"] == {GROUP: {"lift": "rig.lift:Lift"}}


def test_every_unit_and_suffix_is_on_the_page():
    """docs/components.md lists every unit, prefix and suffix that is known, and no other."""
    page = " ".join(text("components.md").split())
    listed = re.search(r"A unit is a name: (.*?); with prefixes (.*?) where usual", page)
    assert set(re.findall(r"[\w%]+", listed[1])) - {"and", "weight", "of", "no", "dimension"} == {
        *BASES, *NAMED, "1",
    }  # fmt: skip
    assert set(listed[2].split(", ")) == set(PREFIXES)
    suffixes = re.search(r"their unit is the suffix: (.*?);", page)
    assert set(re.findall(r"`(\w+)`", suffixes[1])) == set(SUFFIX_UNITS)
