"""The report of studies: what is claimed is all there, and the numbers are kept."""

import csv
import re

import numpy as np
import pytest

from paper.page import page
from paper.report import markdown, write_report
from paper.study import Claim, Figure, Study, Table
from paper.style import line, write_csv

SETTINGS, VERSIONS = {"studies": "made up"}, {"numpy": "2"}
TIME = [0.1, 1 / 3, 1e-300, 12345678.000000002]


def draw(picture):
    axes = picture.subplots()
    axes.plot(TIME, **line(0), label="a line")
    axes.set(xlabel="time (s)", ylabel="height (m)")
    axes.legend()


def claim(where, statement, verdict, **rest):
    return Claim(where, statement, verdict, **{"theirs": "", "ours": "7", "reason": "why"} | rest)


@pytest.fixture
def studies():
    figure = Figure(
        "fig0", "A <title> | piped", "Plant, weights.", {"time_s": TIME}, draw, (4.0, 3.0)
    )
    table = Table(
        "numbers", "Numbers", "Of no kind.", {"name": ["a|b", "c"], "x_m": np.array([1 / 3, 2.0])}
    )
    claims = (
        claim("IV.B", "one holds", "holds"),
        claim("II.D", "a rank & order", "does not hold", theirs="9/13/6", ours="8/8/8"),
        claim("IV.B", "a time ratio", "holds in part", theirs="2.55", ours="1.6"),
        claim("V", "another machine", "not comparable"),
        claim("ours", "a bar", "does not hold", ours="missed by 3 %"),
    )
    return [Study("First", "Some *text*.", (figure,), (table,), claims), Study("Second", "More.")]


def write(studies, folder):
    write_report(studies, folder, settings=SETTINGS, versions=VERSIONS)
    return {file.name: file.read_bytes() for file in folder.iterdir()}


def test_all_there(studies, tmp_path):
    """Every claim with both numbers, every figure, table, setting and version is in both reports."""
    files = write(studies, tmp_path / "out")
    assert set(files) == {
        "report.md", "report.html", "fig0.png", "fig0.svg", "fig0.csv", "numbers.csv",
    }  # fmt: skip
    for name in ("report.md", "report.html"):
        text = files[name].decode().replace("&amp;", "&")
        for each in studies[0].claims:
            for part in (each.statement, each.verdict, each.theirs, each.ours, each.reason):
                assert part in text, (name, part)
        for part in ("First", "Second", "Plant, weights.", "Of no kind.", "made up", "numpy"):
            assert part in text, (name, part)


def test_not_reproduced(studies):
    """What does not hold, or in part, is said again in a section of its own; what holds is not."""
    text = markdown(studies, settings=SETTINGS, versions=VERSIONS)
    section = text.partition("could not reproduce\n")[2].partition("\n## ")[0]
    assert "a rank & order" in section
    assert "Paper: 9/13/6. Here: 8/8/8." in section
    assert "a time ratio" in section
    for absent in ("one holds", "another machine", "a bar"):
        assert absent not in section


def test_same_bytes(studies, tmp_path):
    """The same studies give the same bytes in every file."""
    assert write(studies, tmp_path / "a") == write(studies, tmp_path / "b")


def test_csv_exact(studies, tmp_path):
    """A number in a CSV file is read back as it was, under its name."""
    write(studies, tmp_path)
    with (tmp_path / "fig0.csv").open(newline="") as text:
        head, *rows = csv.reader(text)
    assert head == ["time_s"]
    assert [float(value) for (value,) in rows] == TIME
    with (tmp_path / "numbers.csv").open(newline="") as text:
        assert list(csv.reader(text)) == [["name", "x_m"], ["a|b", repr(1 / 3)], ["c", "2.0"]]


def test_page_alone(studies, tmp_path):
    """The page names no address to load from: drawings are inside, in the page's colours."""
    html = write(studies, tmp_path)["report.html"].decode()
    assert re.findall(r"(?:src|href)=['\"](?!#|data:)([^'\"]*)", html) == [
        "fig0.svg", "fig0.csv", "numbers.csv",
    ]  # fmt: skip
    assert html.count("<svg") == 1
    assert "url(http" not in html
    assert "stroke: var(--k0)" in html
    assert "does not hold</td>" in html


def test_links_are_relative(studies):
    """Pictures and data are linked by their bare names, so that the folder can be moved."""
    text = markdown(studies, settings=SETTINGS, versions=VERSIONS)
    assert re.findall(r"\]\((.*?)\)", text) == ["fig0.png", "fig0.svg", "fig0.csv", "numbers.csv"]


def test_markup_is_text(tmp_path):
    """Angle brackets in a study's words are shown, not obeyed."""
    html = page("# T\n\na <script>alert(1)</script> b\n", {})
    assert "<script" not in html


def test_no_name_twice(studies, tmp_path):
    """Two figures or tables of one name are refused before anything is written."""
    with pytest.raises(ValueError, match="two figures or tables named 'fig0'"):
        write(studies * 2, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_equal_lengths(tmp_path):
    """Columns of different lengths are refused."""
    with pytest.raises(ValueError, match="different lengths"):
        write_csv({"a": [1], "b": [1, 2]}, tmp_path / "x.csv")
