"""Files that are there whole or not at all."""

import errno
from pathlib import Path

import pytest

from orchestrator.recording.whole import whole


def test_no_source_is_written_over(tmp_path):
    """Whichever source it is, by whichever name, it is refused and stays as it was."""
    first, second, link = tmp_path / "a.html", tmp_path / "b.html", tmp_path / "c.html"
    first.write_text("first")
    second.write_text("second")
    link.symlink_to(second)
    for out in (first, second, link):
        with pytest.raises(ValueError, match="is what is read"), whole(out, first, second):
            pass
    assert (first.read_text(), second.read_text()) == ("first", "second")


@pytest.mark.parametrize("out", ["nowhere/out.csv", "folder"])
def test_what_cannot_be_written_is_named(out, tmp_path):
    """A folder that is not there, or is in the way, is told of the file that was asked for."""
    (tmp_path / "folder").mkdir()
    with (
        pytest.raises(OSError, match=f"{out}: cannot be written, "),
        whole(tmp_path / out) as partial,
    ):
        partial.write_text("new")
    assert [each.name for each in tmp_path.iterdir()] == ["folder"]


def written(out, failure):
    """Write half of a file, then fail."""
    with whole(out) as partial:
        partial.write_text("half")
        failure()


def full():
    """Fail as a full disk does."""
    raise OSError(errno.ENOSPC, "no space")


def test_a_full_disk_is_one_of_writing(tmp_path):
    """An error that names no file is told of the one to be written, which is what it was."""
    out = tmp_path / "out.csv"
    out.write_text("old")
    with pytest.raises(OSError, match=r"out\.csv: cannot be written, no space"):
        written(out, full)
    assert out.read_text() == "old"
    assert list(tmp_path.iterdir()) == [out]


def told():
    """Fail as a reader does that says itself what is wrong."""
    raise OSError("lost.mcap: cannot be read")


@pytest.mark.parametrize("failure", [Path("lost.mcap").read_bytes, told])
def test_an_error_of_reading_is_told_as_it_is(failure, tmp_path):
    """What names another file, or says itself what is wrong, is none of writing."""
    with pytest.raises(OSError, match=r"lost\.mcap") as caught:
        written(tmp_path / "out.csv", failure)
    assert "cannot be written" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []
