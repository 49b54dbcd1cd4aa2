"""The learned basis against full order: what an excess is, on references of every kind."""

import numpy as np
import pytest

from paper import learned_basis
from paper.learn import level_flight

H = 30


def test_everything_costs_nothing_more():
    """The identity as a basis has no excess, and fewer functions have some."""
    every = np.eye(4 * H).reshape(4, H, 4 * H)
    bases = {"all": lambda _: every, "some": lambda _: every[..., ::9]}
    found = learned_basis.compare(learned_basis.EQUAL, bases, (25.0,), H)
    for kind in learned_basis.KINDS:
        assert found["all", kind].largest == pytest.approx(0.0, abs=1e-4)
        assert found["some", kind].median > 0.0


@pytest.mark.parametrize("kind", learned_basis.KINDS[:4])
def test_references_start_at_the_aircraft(kind):
    """Over terrain a reference begins where level flight does: its first errors are small."""
    flight = level_flight("attitude", 25.0, H, learned_basis.EQUAL)
    e = learned_basis.references(kind, flight, 4).reshape(4, 13, H)
    assert np.isfinite(e).all()
    assert np.abs(e[:, :5, 0]).max() < 2.0
    assert np.abs(e).max() > 0.0
