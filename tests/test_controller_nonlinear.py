"""Direct nonlinear MPC behind the same component: it flies, and what fails leaves the old plan."""

import numpy as np
import pytest
from hand_flight import HandFlight

from controller import nonlinear
from controller.nonlinear import NonlinearMpc
from controller.parameters import MpcParameters
from controller.update import LADDER
from plant.prediction import HelicopterModel, ModelParameters

SHORT = {"horizon_s": 1.5, "passes_at_start": 2}
HIGH = {"height_agl_m": 12.0}


def flight(**injected):
    return HandFlight(SHORT, HIGH, controller=NonlinearMpc, **injected)


@pytest.fixture(scope="module")
def flown():
    one = flight()
    return one, one.fly(4)


def test_flies_down_to_the_reference(flown):
    """From 2 m too high it comes down to the height asked for, every plan better than the last."""
    one, log = flown
    assert all(row["ladder"] <= LADDER.index("shorter step") for row in log)
    assert all(row["cost.after"] < row["cost.before"] for row in log)
    altitude = -one.state()[2]
    assert abs(altitude - 10.0) < 0.5
    assert one.mpc.describe().modelName == "NonlinearMpc"


def test_same_flight_same_bits(flown):
    """A second flight is the first, bit for bit: iterations are capped, not time."""
    again = flight().fly(2)
    for row, other in zip(flown[1], again, strict=False):
        for name, value in other.items():
            np.testing.assert_array_equal(row[name], value, err_msg=name)


@pytest.mark.parametrize("answer", [np.nan, 1e3])
def test_failed_search_leaves_the_shifted_plan(monkeypatch, answer):
    """Where the solver returns no number, or worse than the old plan, the old plan's tail flies."""
    shoot = nonlinear.shooter

    def failing(*args, **kwargs):
        solve = shoot(*args, **kwargs)
        return lambda state, u, goal, **known: solve(state, u, goal, **known)._replace(
            u=np.full_like(u, answer)
        )

    monkeypatch.setattr(nonlinear, "shooter", failing)
    one = flight()
    plan = one.mpc.get(["plan.thrust"])["plan.thrust"]
    (row,) = one.fly(1)
    assert row["ladder"] == LADDER.index("old tail")
    assert row["cost.after"] == row["cost.before"]
    np.testing.assert_array_equal(row["plan.thrust"], plan)


def test_needs_a_symbolic_model():
    """A prediction model without a symbolic form is refused when the controller is made."""
    model = HelicopterModel(ModelParameters(rotor="collective"))
    with pytest.raises(ValueError, match="got rotor 'collective', expected 'thrust'"):
        NonlinearMpc(MpcParameters(**SHORT), prediction_model=model)
