"""A learned basis: columns from a file, at a speed and a horizon, for the commands it is of."""

from pathlib import Path

import numpy as np
import pytest

from controller.learned import Learned, learned_basis, read_basis
from controller.mpc import BasisMpc
from controller.parameters import MpcParameters, design
from plant.prediction import HelicopterModel, ModelParameters

FILE = Path(__file__).parents[1] / "scenarios" / "bases" / "learned_attitude.npz"
COMMANDS = ("thrust", "pitch", "roll", "heading")
MADE = Learned(
    np.array([20.0, 30.0, 40.0]),
    np.random.default_rng(0).standard_normal((3, 4, 50, 8)),
    COMMANDS,
    0.05,
)


def columns(horizon, count, speed, commands=COMMANDS):
    return learned_basis(
        MADE, horizon, count, speed=speed, commands=commands, sample_period=0.05
    ).reshape(-1, count)


def same_span(A, B):
    return np.allclose(A @ np.linalg.lstsq(A, B)[0], B)


@pytest.mark.parametrize("horizon", [50, 20])
def test_columns_are_orthonormal_over_all_channels(horizon):
    """Phi' Phi, summed over samples and channels, is 4 H I at any horizon."""
    Phi = columns(horizon, 5, 27.0)
    np.testing.assert_allclose(Phi.T @ Phi, 4 * horizon * np.eye(5), atol=1e-9)


def test_a_speed_between_has_directions_between():
    """At a trained speed the span is what was learned there; halfway it is that of the mean."""
    at, between, outside = (columns(50, 5, speed) for speed in (30.0, 35.0, 90.0))
    learned = MADE.columns[..., :5].reshape(3, -1, 5)
    assert same_span(at, learned[1])
    assert same_span(between, 0.5 * (learned[1] + learned[2]))
    assert same_span(outside, learned[2])


def test_fewer_columns_are_the_first_ones():
    """The spans of 1, 2, 3, ... directions are nested."""
    assert np.allclose(columns(50, 7, 25.0)[:, :3], columns(50, 3, 25.0))


@pytest.mark.parametrize(
    ("horizon", "count", "commands", "match"),
    [
        (51, 5, COMMANDS, "too many samples, got 51, expected up to 50"),
        (50, 9, COMMANDS, "too many directions, got 9, expected up to 8"),
        (50, 5, ("thrust", "pitch", "roll", "tail"), "wrong commands"),
    ],
)
def test_what_was_not_learned_is_refused(horizon, count, commands, match):
    """Longer, more, or for other commands: one line that says what there is."""
    with pytest.raises(ValueError, match=match):
        columns(horizon, count, 30.0, commands)


def test_a_file_of_something_else_is_refused(tmp_path):
    """A file without directions is no learned basis."""
    other = tmp_path / "other.npz"
    np.savez(other, elevation=np.zeros(3))
    text = tmp_path / "text.npz"
    text.write_text("not a zip")
    for file in (other, text):
        with pytest.raises(ValueError, match="no learned basis"):
            read_basis(file)


def test_a_controller_without_a_file_is_refused():
    """`basis: learned` without `basis_file` is an error at construction."""
    model = HelicopterModel(ModelParameters())
    with pytest.raises(ValueError, match="basis learned: no file"):
        BasisMpc(MpcParameters(basis="learned"), prediction_model=model)


def test_five_per_channel_are_twenty_coupled_ones():
    """The number per channel counts four times, and every column acts on every channel."""
    model = HelicopterModel(ModelParameters())
    parameters = MpcParameters(basis="learned", basis_file=FILE, bases_per_channel=5)
    Phi = design(parameters, model, 120).Phi
    assert Phi.shape == (4, 120, 20)
    assert Phi.any(axis=1).all()


def test_the_file_that_comes_along_is_small():
    """The learned basis of the scenarios is below half a megabyte."""
    assert FILE.stat().st_size < 500_000
