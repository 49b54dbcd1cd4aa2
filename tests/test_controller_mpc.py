"""The controller as a component, in flights by hand with a perfect model."""

import numpy as np
import pytest
from fmpy.validation import validate_model_description
from hand_flight import CELL, PER_UPDATE, TICK, HandFlight, flat, hills, outputs_of

from controller.mpc import BasisMpc
from controller.mpc_variables import SOLVER
from controller.parameters import TUNABLE, MpcParameters
from controller.update import LADDER
from plant.helicopter import HelicopterModel, ModelParameters
from plant.rotorcraft import STATES

AXES = ("north", "east", "down")
BASES = {
    "laguerre": {"basis": "laguerre", "bases_per_channel": 5},
    "tent": {"basis": "tent", "bases_per_channel": 10},
    "laguerre_function": {"basis": "laguerre_function", "bases_per_channel": 8},
}
OFF_COURSE = {
    "north_m": 0.0,
    "east_m": 4.0,
    "height_agl_m": 14.0,
    "heading_deg": 10.0,
}


def mpc(parameters=None, form="attitude", **injected):
    model = HelicopterModel(ModelParameters(command=form))
    return BasisMpc(MpcParameters(**(parameters or {})), prediction_model=model, **injected)


def variables(component):
    return {one.name: one for one in component.describe().modelVariables}


def assert_same(left, right):
    """Hold that two logs of outputs are equal, bit for bit."""
    for one, other in zip(left, right, strict=True):
        for name, value in one.items():
            np.testing.assert_array_equal(value, other[name], err_msg=name)


# -- what it says it is ----------------------------------------------------------------------------


@pytest.mark.parametrize("form", ["attitude", "actuator"])
def test_describes_itself(form):
    """The description is valid; the plan has the channels of its form, and feeds through."""
    component = mpc(form=form)
    description = component.describe()
    assert validate_model_description(description) == []
    found = variables(component)
    fourth = {"attitude": "heading", "actuator": "tail"}[form]
    for channel, unit in (("thrust", "G"), ("pitch", "rad"), ("roll", "rad")):
        assert found[f"plan.{channel}"].unit == unit
    assert {name for name in found if name.startswith("plan.")} == {
        "plan.sequence", "plan.start_time", "plan.sample_period", "plan.thrust", "plan.pitch",
        "plan.roll", f"plan.{fourth}",
    }  # fmt: skip
    assert {name for name in found if name.startswith("state.")} == {f"state.{n}" for n in STATES}
    shapes = {name: found[name].shape for name in (f"plan.{fourth}", "path.north", "scan.source")}
    p = MpcParameters()
    assert shapes == {
        f"plan.{fourth}": (p.plan_capacity,),
        "path.north": (p.plan_capacity,),
        "scan.source": (p.scan_capacity,),
    }
    for unknown in description.outputs:
        assert {one.name.partition(".")[0] for one in unknown.dependencies} == {"state", "scan"}
    assert {name for name, one in found.items() if one.variability == "tunable"} == set(TUNABLE)


def test_describing_changes_nothing_and_does_not_change():
    """In mid-flight the description is what it was before, and the flight goes on alike."""
    one, other = HandFlight(ground=hills), HandFlight(ground=hills)
    before = [(v.name, v.start, v.shape) for v in one.mpc.describe().modelVariables]
    one.fly(2)
    other.fly(2)
    assert [(v.name, v.start, v.shape) for v in one.mpc.describe().modelVariables] == before
    assert_same(one.fly(2), other.fly(2))


def test_every_output_has_its_declared_shape_at_any_time():
    """Before and after updates an output is a float, or a float array of the declared shape."""
    flight = HandFlight(ground=hills)
    shapes = {name: variables(flight.mpc)[name].shape for name in flight.outputs}
    for log in (mpc().get(flight.outputs), flight.mpc.get(flight.outputs), flight.fly(1)[0]):
        assert {name: np.shape(value) for name, value in log.items()} == shapes
        assert all(np.all(np.isfinite(value)) for value in log.values())


def test_an_unknown_name_is_an_error_with_the_nearest():
    """Neither set nor get takes a name that the description lacks."""
    component = mpc()
    with pytest.raises(KeyError, match=r"'state\.thetta'.*'state\.theta'"):
        component.set({"state.thetta": 0.0})
    with pytest.raises(KeyError, match=r"'plan\.trust'.*'plan\.thrust'"):
        component.get(["plan.trust"])


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"horizon_s": 12.0}, "horizon longer than a plan, got 12 s, expected up to 10 s"),
        ({"basis": "bspline", "bases_per_channel": 3}, "too few functions, got 3"),
        ({"waypoints_m": ((0.0, 0.0),)}, "way-points: no course"),
    ],
)
def test_a_design_that_cannot_be_is_refused(parameters, message):
    """What does not fit together is refused when the component is made."""
    with pytest.raises(ValueError, match=message):
        mpc(parameters)


def test_without_a_state_the_plan_is_trim():
    """Initialized before anything was measured, plan 0 holds trim along the first leg."""
    component = mpc({"waypoints_m": ((0.0, 0.0), (0.0, 500.0))})
    component.initialize(start_time=0.0)
    plan = component.get(["plan.sequence", "plan.thrust", "plan.heading"])
    command = HelicopterModel(ModelParameters()).trim(30.0)[1]
    assert plan["plan.sequence"] == 0
    np.testing.assert_array_equal(plan["plan.thrust"], command[0])
    np.testing.assert_allclose(plan["plan.heading"], command[3] + np.pi / 2)


def test_what_is_got_is_a_copy():
    """Spoiling an array that was got, or set, spoils nothing inside."""
    flight = HandFlight(ground=hills)
    flight.mpc.get(["plan.thrust"])["plan.thrust"][:] = 9.0
    assert flight.mpc.get(["plan.thrust"])["plan.thrust"].max() < 4.0
    burst = np.zeros(flight.parameters.scan_capacity)
    flight.mpc.set({"scan.elevation": burst})
    burst[:] = 1e6
    twin = HandFlight(ground=hills)
    twin.mpc.set({"scan.elevation": np.zeros(flight.parameters.scan_capacity)})
    assert_same([flight.update()], [twin.update()])


# -- what it promises at every tick ----------------------------------------------------------------


@pytest.mark.parametrize("form", ["attitude", "actuator"])
@pytest.mark.parametrize("basis", BASES)
def test_every_plan_keeps_its_promises(basis, form):
    """From off course: merit never above the shifted plan's, commands within bounds, all finite."""
    flight = HandFlight(BASES[basis], {"command": form, **OFF_COURSE}, ground=hills)
    for outputs in flight.fly(6):
        assert outputs["cost.after"] <= outputs["cost.before"]
        assert outputs["ladder"] in (0, 1, 2)
        assert outputs["solver_status"] == SOLVER.index("optimal")
        for channel, low, high in zip(
            flight.model.commands, flight.model.command_min, flight.model.command_max, strict=True
        ):
            samples = outputs[f"plan.{channel}"]
            assert np.all((samples >= low) & (samples <= high))
        for bound, name in zip(
            flight.model.actuator_max, ("thrust", "pitch", "roll"), strict=False
        ):
            assert flight.vehicle.get([f"actuator.{name}"])[f"actuator.{name}"] <= bound


@pytest.mark.parametrize("latency_s", [0.0, 0.3, 0.5, 0.7, 1.0])
def test_the_predicted_samples_are_the_flight_to_come(latency_s):
    """With a perfect model a plan begins where the aircraft will be, to the last bit, and on time.

    The path, sample by sample, is flown until the next plan takes over; and there is no bias.
    """
    flight = HandFlight(BASES["tent"], OFF_COURSE, ground=hills, latency_s=latency_s)
    plans, flown = [], []
    for _ in range(8):
        flight.measure()
        plans.append(flight.update())
        assert plans[-1]["plan.start_time"] == pytest.approx(flight.time + latency_s)
        for _ in range(PER_UPDATE):
            flight.play(1)
            flown.append(flight.state()[:3])
    for plan in plans[: 8 - round(latency_s / 0.5 + 0.49)]:
        first = round(plan["plan.start_time"] / TICK)
        path = np.stack([plan[f"path.{axis}"][:PER_UPDATE] for axis in AXES], axis=1)
        np.testing.assert_array_equal(path, flown[first : first + PER_UPDATE])
        assert [plan[f"bias.{axis}"] for axis in AXES] == [0.0, 0.0, 0.0]


def test_the_path_ends_where_its_horizon_does():
    """Beyond the horizon the predicted path stays at its last point."""
    outputs = HandFlight(ground=hills, reach_m=200.0).fly(1)[0]
    horizon = round(outputs["horizon"] / TICK)
    assert horizon < 200
    assert np.all(np.diff(outputs["path.north"][:horizon]) > 1.0)
    np.testing.assert_array_equal(
        outputs["path.north"][horizon:], outputs["path.north"][horizon - 1]
    )


def test_the_published_reference_is_where_the_aircraft_goes():
    """It starts ten metres behind the aircraft, runs along the course, at the set height."""
    flight = HandFlight()
    log = flight.fly(3)
    north = flight.time - PER_UPDATE * TICK
    assert log[-1]["reference.north"][0] == pytest.approx(30.0 * north - 10.0, abs=1.5)
    np.testing.assert_allclose(np.diff(log[-1]["reference.north"]), 2.0, atol=1e-9)
    np.testing.assert_allclose(log[-1]["reference.altitude"], 10.0, atol=1e-6)
    np.testing.assert_allclose(log[-1]["reference.speed"][:150], 30.0, atol=1e-9)


# -- mismatch --------------------------------------------------------------------------------------


@pytest.mark.parametrize("basis", ["laguerre", "tent"])
def test_the_bias_estimate_removes_the_offset_of_a_heavier_helicopter(basis):
    """With 10 % more mass the height is held to 5 cm; without the estimate it is 0.3 m and more low."""
    heavy = {"mass_kg": 74.8}
    with_estimate = HandFlight(BASES[basis], heavy)
    bias = with_estimate.fly(20)[-1]["bias.down"]
    without = HandFlight({**BASES[basis], "bias_estimate": False}, heavy)
    log = without.fly(20)
    assert abs(-with_estimate.state()[2] - 10.0) < 0.05
    assert -without.state()[2] - 10.0 < -0.3
    assert log[-1]["bias.down"] == 0.0
    assert bias == pytest.approx(9.80665 * (1 - 68.0 / 74.8), rel=0.15)


def test_nothing_but_finite_plans_leaves_a_controller_that_is_shown_nan():
    """A NaN in the state is a warning: the old plan goes on, said so, and so does the flight."""
    flight = HandFlight(ground=hills)
    before = flight.fly(3)[-1]
    flight.measure()
    flight.mpc.set({"state.q": np.nan})
    assert flight.mpc.step(flight.time, 0.5) == 1
    outputs = flight.mpc.get(flight.outputs)
    assert_same([{n: outputs[n] for n in flight.plan}], [{n: before[n] for n in flight.plan}])
    assert LADDER[outputs["ladder"]] == "old tail"
    assert SOLVER[outputs["solver_status"]] == "none"
    assert outputs["step_length"] == 0.0
    flight.play()
    assert flight.sequencer.get(["playing.source"])["playing.source"] == 1  # tail
    after = flight.fly(2)
    assert [LADDER[one["ladder"]] for one in after] == ["full step", "full step"]
    assert after[-1]["plan.sequence"] == before["plan.sequence"] + 2
    assert after[-1]["bias.down"] == 0.0


def test_flies_where_nothing_was_ever_sensed():
    """Without a single cell the reference is level flight at the height of the start."""
    flight = HandFlight(ground=lambda north, east: np.full(north.shape, np.nan))
    log = flight.fly(4)
    assert {one["horizon"] for one in log} == {2.0}
    np.testing.assert_allclose(flight.state()[1:3], [0.0, -10.0], atol=1e-6)


# -- terrain only from scans -----------------------------------------------------------------------


def test_terrain_that_was_not_scanned_has_no_effect():
    """Two worlds that are alike up to a cliff give the same plans, bit for bit, until it is seen."""
    cliff, reach = 380.0, 200.0

    def cliffs(north, east):
        return hills(north, east) + np.where(north >= cliff, 15.0, 0.0)

    alike, cliffy = (
        HandFlight(ground=hills, reach_m=reach),
        HandFlight(ground=cliffs, reach_m=reach),
    )
    for _ in range(15):
        unseen = alike.state()[0] + reach <= cliff
        left, right = alike.fly(1), cliffy.fly(1)
        if unseen:
            assert_same(left, right)
    assert not unseen
    assert not np.array_equal(left[0]["plan.thrust"], right[0]["plan.thrust"])


def test_a_ring_that_is_read_late_loses_no_burst():
    """Cells of several bursts in the ring, written since the last update, all count."""
    flight, twin = HandFlight(ground=hills), HandFlight(ground=hills)
    flight.fly(1)
    twin.fly(1)
    for one in (flight, twin):
        one.measure()
    size = flight.parameters.scan_capacity
    rows = np.arange(0.0, 900.0, CELL)
    n, e = (a.ravel() for a in np.meshgrid(rows, np.arange(-50.0, 51.0, CELL), indexing="ij"))
    count = 2 * size + n.size  # the newest cells overwrite the beginning of the ring
    ring = {name: np.full(size, np.nan) for name in ("north", "east", "elevation")}
    ring["north"][: n.size], ring["east"][: n.size] = n, e
    ring["elevation"][: n.size] = hills(n, e)
    flight.mpc.set({"scan.count": count} | {f"scan.{name}": a for name, a in ring.items()})
    assert flight.update()["horizon"] == twin.update()["horizon"] == 10.0


# -- state -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("latency_s", [0.0, 0.7])
def test_a_flight_goes_on_from_a_saved_state_bit_for_bit(latency_s):
    """Saved in mid-flight and restored into new components, every output is the same for ever."""
    setting = {"vehicle": {**OFF_COURSE, "mass_kg": 70.0}, "ground": hills, "latency_s": latency_s}
    flight = HandFlight(BASES["tent"], **setting)
    flight.mpc.set({"height_agl_m": 12.0})
    flight.fly(4)
    restored = HandFlight(BASES["tent"], **setting)
    for name in ("vehicle", "mpc", "sequencer"):
        getattr(restored, name).set_state(getattr(flight, name).get_state())
    restored.tick, restored.pending = flight.tick, list(flight.pending)
    assert_same(flight.fly(5), restored.fly(5))
    np.testing.assert_array_equal(flight.state(), restored.state())


def test_saving_the_state_changes_nothing_and_restoring_undoes_everything():
    """A controller that planned on and is taken back plans the same again."""
    flight = HandFlight(ground=hills)
    flight.fly(2)
    flight.measure()
    saved = flight.mpc.get_state()
    first = flight.update()
    flight.mpc.set({"speed_mps": 20.0})
    for _ in range(3):
        flight.update()
    flight.mpc.set_state(saved)
    assert_same([first], [flight.update()])


def test_initializing_again_starts_afresh():
    """A second initialization forgets the first flight, its terrain and its plan."""
    flight = HandFlight(ground=hills)
    first = flight.mpc.get(flight.outputs)
    flight.fly(3)
    flight.tick = 0
    flight.vehicle.initialize(start_time=0.0)
    flight.measure()
    flight.mpc.initialize(start_time=0.0)
    assert_same([first], [flight.mpc.get(flight.outputs)])
    flight.mpc.terminate()
    flight.mpc.terminate()


# -- tunable parameters ----------------------------------------------------------------------------


@pytest.mark.parametrize("name", TUNABLE)
def test_tunable_parameters_act_at_the_next_update(name):
    """Set in flight, every one of them reads back, and changes the next plan."""
    flight, twin = (HandFlight(vehicle=OFF_COURSE, ground=hills) for _ in range(2))
    for one in (flight, twin):
        one.fly(2)
        one.measure()
    value = 1.3 * twin.mpc.get([name])[name]
    flight.mpc.set({name: value})
    assert flight.mpc.get([name]) == {name: value}
    tuned, usual = flight.update(), twin.update()
    assert np.abs(tuned["plan.thrust"] - usual["plan.thrust"]).max() > 1e-6


def test_a_new_set_height_is_flown():
    """Five metres more are approached without overshoot and held."""
    flight = HandFlight(BASES["tent"], ground=flat)
    flight.fly(2)
    flight.mpc.set({"height_agl_m": 15.0})
    heights = []
    for _ in range(20):
        flight.fly(1)
        heights.append(-flight.state()[2])
    assert heights[-1] == pytest.approx(15.0, abs=0.05)
    assert max(heights) < 15.2
    assert outputs_of(flight.mpc) == flight.outputs


@pytest.mark.parametrize(("name", "value"), [("speed_mps", 0.0), ("altitude_weight", -1.0)])
def test_a_tunable_out_of_range_is_refused(name, value):
    """A tunable parameter that no plan could use is a ValueError that names it."""
    mpc = BasisMpc(MpcParameters(), prediction_model=HelicopterModel(ModelParameters()))
    with pytest.raises(ValueError, match=f"{name}: out of range"):
        mpc.set({name: value})
    mpc.set({"altitude_weight": 0.0})
