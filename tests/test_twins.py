"""Files that two packages hold alike, because neither may import the other."""

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("name", ["jit.py", "variables.py"])
def test_they_stay_alike(name):
    """The plant's and the controller's copies have the same text."""
    assert (ROOT / "plant" / name).read_bytes() == (ROOT / "controller" / name).read_bytes()
