"""The command ``hedgehop paper``."""

import sys
from types import ModuleType

import pytest

from orchestrator.errors import ScenarioError
from paper import command
from paper.study import Study


@pytest.fixture
def studies(monkeypatch):
    """Two studies of made-up figures 1 and 2; the second can be made to fail."""
    asked = []
    for number in (1, 2):
        module = ModuleType(f"paper.made_up_{number}")
        module.FIGURES = (number,)

        def study(quick, progress, number=number):
            asked.append((number, quick))
            progress("half way")
            if "fail" in asked:
                raise RuntimeError("out of paper")
            return Study(f"Study {number}", "Text.")

        module.study = study
        monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setattr(command, "MODULES", ("made_up_1", "made_up_2"))
    return asked


def test_all_in_order(studies, tmp_path, capsys):
    """Without a figure all studies run in order, a line per step on stderr, and the report is named."""
    command.paper(quick=True, out=tmp_path)
    assert studies == [(1, True), (2, True)]
    text = (tmp_path / "report.md").read_text()
    assert text.index("## Study 1") < text.index("## Study 2")
    said = capsys.readouterr()
    assert "2/2 made up 2: half way\n" in said.err
    assert said.out == f"{tmp_path / 'report.html'}: written\n"


def test_one_figure(studies, tmp_path):
    """A figure runs its study only."""
    command.paper(figure=2, out=tmp_path)
    assert studies == [(2, False)]


def test_unknown_figure(studies, tmp_path):
    """A figure that the paper does not have is an error that lists those it has."""
    with pytest.raises(ScenarioError, match=r"got 9, expected one of \[1, 2\]"):
        command.paper(figure=9, out=tmp_path)
    assert not studies


def test_nothing_is_lost(studies, tmp_path, monkeypatch):
    """If a study fails, what came before it is written."""
    studies.append("fail")
    with pytest.raises(RuntimeError, match="out of paper"):
        command.paper(out=tmp_path / "none")
    assert not (tmp_path / "none" / "report.md").exists()
    studies.remove("fail")

    def broken(quick, progress):
        raise RuntimeError("out of ink")

    monkeypatch.setattr(sys.modules["paper.made_up_2"], "study", broken)
    with pytest.raises(RuntimeError, match="out of ink"):
        command.paper(out=tmp_path)
    assert "## Study 1" in (tmp_path / "report.md").read_text()


def test_missing_extra(studies, tmp_path, monkeypatch):
    """Without the extra's packages one line names what is missing and how to get it."""
    monkeypatch.setattr(command, "find_spec", lambda name: None if name == "casadi" else True)
    with pytest.raises(ScenarioError, match=r"got no casadi, expected `pip install casadi`"):
        command.paper(out=tmp_path)
    assert not studies


def test_unwritable(studies, tmp_path):
    """A folder that cannot be made is an error, before anything is run."""
    (tmp_path / "file").touch()
    with pytest.raises(ScenarioError, match="cannot be written"):
        command.paper(out=tmp_path / "file" / "under")
    assert not studies
