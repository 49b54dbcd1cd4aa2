"""Learning a basis: optimal moves, their principal directions, and what they leave out."""

import json

import numpy as np
import pytest

from orchestrator.errors import ScenarioError
from paper import learn
from paper.command import learn_basis

H, Q = 30, (1.0, 1.0, 10.0, 10.0, 1.0)


@pytest.fixture(scope="module")
def flights():
    return [learn.level_flight("attitude", speed, H, Q) for speed in (25.0, 30.0)]


def training(flights, kind, number=30):
    return [learn.errors(kind, number, one, np.random.default_rng(0)) for one in flights]


def test_optimal_moves_are_stationary(flights):
    """At the optimum the gradient S'(e + S u) vanishes, and J is what is left of the squares."""
    flight, e = flights[0], training(flights, "terrain")[0]
    u, J = learn.optimal(flight, e)
    rest = e.T + flight.S @ u
    np.testing.assert_allclose(flight.S.T @ rest, 0.0, atol=1e-6 * np.abs(flight.S.T @ e.T).max())
    np.testing.assert_allclose(J, np.square(rest).sum(axis=0), rtol=1e-6, atol=1e-6)


def test_a_basis_costs_the_distance_of_the_moves(flights):
    """The excess of a basis is the squared distance of the optimal move from its span, in M's norm."""
    flight, e = flights[0], training(flights, "offset")[0]
    B = np.random.default_rng(1).standard_normal((4 * H, 9))
    u, J = learn.optimal(flight, e)
    within, cost = learn.optimal(flight, e, B)
    apart = np.square(flight.L.T @ (u - within)).sum(axis=0)
    np.testing.assert_allclose(cost - J, apart, rtol=1e-6, atol=1e-6 * cost.max())


@pytest.mark.parametrize("count", [2, 6])
def test_no_other_directions_are_better_for_the_training_set(flights, count, monkeypatch):
    """Principal directions lose less of their training set than random ones of its own moves."""
    monkeypatch.setattr(learn, "FLOOR", 0.0)
    flight, e = flights[0], training(flights, "terrain")[0]
    best = learn.principal_directions([flight], [[e]], [1.0], count)[0]
    u, J = learn.optimal(flight, e)
    rng = np.random.default_rng(2)
    others = [u @ rng.standard_normal((u.shape[1], count)) for _ in range(5)]
    lost = [np.sum(learn.optimal(flight, e, B)[1] / J - 1.0) for B in (best, *others)]
    assert lost[0] < min(lost[1:])


def test_directions_are_answers_to_the_same_references(flights):
    """With as many directions as there are references, every speed's span holds its own moves."""
    e = training(flights, "step", 5)
    found = learn.principal_directions(flights, [e], [1.0], 5)
    for flight, one, B in zip(flights, e, found, strict=True):
        _, J = learn.optimal(flight, one)
        _, cost = learn.optimal(flight, one, B)
        np.testing.assert_allclose(cost, J, rtol=1e-6)


def test_an_optimal_plan_leaves_little_to_do(flights):
    """One update on, the shifted optimal plan leaves less error than no plan at all."""
    e = training(flights, "terrain")[0]
    left = training(flights, "update")[0]
    assert np.square(left).sum() < 0.2 * np.square(e).sum()


def test_a_short_training_fills_its_shape():
    """Directions come for every speed, channel and sample, and are finite."""
    found = learn.train(speeds=(28.0, 32.0), horizon=H, per_kind=8, number=6, Q=Q)
    assert found.shape == (2, 4, H, 6)
    assert np.isfinite(found).all()


def test_a_file_says_where_it_comes_from_and_comes_out_the_same(tmp_path, monkeypatch):
    """The same form and seed write the same bytes, with settings, versions and plant inside."""
    monkeypatch.setattr(learn, "train", _short)
    for name in ("a.npz", "b.npz"):
        learn.write_basis(tmp_path / name, seed=3)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    with np.load(tmp_path / "a.npz") as found:
        about = json.loads(str(found["provenance"]))
    assert about["seed"] == 3
    assert about["plant"].startswith("plant-")
    assert {"numpy", "scipy", "hedgehop", "kinds", "Q"} <= set(about)


def test_a_file_that_cannot_be_written_is_a_plain_error(tmp_path, monkeypatch):
    """A folder that is not there is one line, not a traceback."""
    monkeypatch.setattr(learn, "train", _short)
    with pytest.raises(ScenarioError, match="cannot be written"):
        learn_basis(out=tmp_path / "no" / "a.npz")


def _short(form, seed, *, Q, progress):
    rng = np.random.default_rng(seed)
    return rng.standard_normal((len(learn.SPEEDS), 4, 5, 3))
