"""A system of ports without components, and a made-up flight to tell listeners about."""

from pathlib import Path

import numpy as np

from orchestrator.assembly.description import Port
from orchestrator.assembly.system import Schedule, System
from orchestrator.assembly.units import Unit
from orchestrator.listener import Result
from orchestrator.scenario.records import RecordingSpec, ResourceSpec, Scenario

TICK_NS = 50_000_000
POSITION, ANGLES = ("north", "east", "down"), ("phi", "theta", "psi")
STATES = (*POSITION, *"uvw", *ANGLES, *"pqrab", "thrust", *"cd")
LADDER = dict(enumerate(("full step", "shorter step", "old tail", "trim")))
OUTCOME = dict(enumerate(("flying", "collision", "departed", "left_terrain")))
SCENE = {
    "pose": "vehicle.pose",
    "velocity": "vehicle.velocity",
    "clearance": "vehicle.clearance",
    "load_factor": "vehicle.load_factor",
    "controls": "vehicle.actuator",
    "plan": "mpc.plan",
    "path": "mpc.path",
    "reference": "mpc.reference",
    "ladder": "mpc.ladder",
    "height_agl": "mpc.height_agl_m",
}


def port(component, name, unit="m", *, causality="output", kind="Float64", **more):
    """Return a port; continuous if it is a number with a fraction, discrete otherwise."""
    more.setdefault("variability", "continuous" if kind == "Float64" else "discrete")
    if kind != "Float64":
        unit = None
    return Port(
        component=component,
        name=name,
        causality=causality,
        type=kind,
        unit=None if unit is None else Unit(unit),
        **more,
    )


def make_system(ports, scene=None, *, links=(), wall_clock=False, **scenario):
    """Return a system of these ports that has no instances and runs for 60 s."""
    table = {}
    for each in ports:
        table.setdefault(each.component, {})[each.name] = each
    return System(
        instances={},
        ports=table,
        schedule=Schedule(60 * 10**9, TICK_NS, 10 * TICK_NS, {}, {}, (), ()),
        links=tuple(links),
        scenario=Scenario(
            title="a made-up flight",
            duration_s=60.0,
            resources=(ResourceSpec("terrain", "plant.terrain:Terrain", {"file": "hill.npz"}),),
            scene=scene or {},
            recording=RecordingSpec(wall_clock=wall_clock),
            folder=Path(__file__).parent,
            **scenario,
        ),
    )


def helicopter(*, capacity=200, posts=60, cells=1000, **more):
    """Return a system with the ports of the whole helicopter scenario."""
    ports = [port("vehicle", f"state.{name}", "m") for name in STATES]
    ports += [port("vehicle", f"pose.{name}", "m") for name in POSITION]
    ports += [port("vehicle", f"pose.{name}", "rad") for name in ANGLES]
    ports += [port("vehicle", f"velocity.{name}", "m/s") for name in POSITION]
    bounds = {
        "thrust": (0.0, 3.5),
        "pitch": (-0.35, 0.35),
        "roll": (-0.35, 0.35),
        "tail": (-0.5, 0.5),
    }
    ports += [
        port("vehicle", f"actuator.{name}", "rad", min=low, max=high)
        for name, (low, high) in bounds.items()
    ]
    ports += [port("vehicle", "clearance"), port("vehicle", "load_factor", "G")]
    ports += [port("vehicle", "outcome", kind="Enumeration", items=OUTCOME)]
    ports += [port("vehicle", "valid", kind="Boolean")]
    ports += [port("gust", f"wind.{name}", "m/s") for name in POSITION]
    ports += [port("sensor", f"scan.{name}", kind="Int64") for name in ("sequence", "count")]
    held = {"variability": "discrete"}
    ports += [port("sensor", f"scan.{name}", **held) for name in ("stamp", "cell_size")]
    ports += [
        port("sensor", f"scan.{name}", shape=(cells,), **held)
        for name in ("north", "east", "elevation")
    ]
    ports += [port("sensor", "scan.source", kind="Int64", shape=(cells,))]
    ports += [port("mpc", "height_agl_m", causality="parameter", variability="tunable")]
    ports += [port("mpc", "plan.sequence", kind="Int64")]
    ports += [
        port("mpc", f"plan.{name}", "rad", shape=(capacity,), **held)
        for name in ("thrust", "pitch", "roll", "heading")
    ]
    ports += [port("mpc", f"path.{name}", shape=(capacity,)) for name in POSITION]
    ports += [
        port("mpc", f"reference.{name}", shape=(posts,), **held)
        for name in ("north", "east", "altitude", "heading", "speed")
    ]
    ports += [port("mpc", "ladder", kind="Enumeration", items=LADDER)]
    ports += [port("mpc", f"cost.{name}", "1") for name in ("before", "after", "linear")]
    ports += [port("mpc", name, "1") for name in ("step_length", "slack", "horizon")]
    ports += [port("sequencer", f"command.{name}", "rad") for name in bounds]
    ports += [port("sequencer", "playing.sequence", kind="Int64")]
    ports += [port("sequencer", "playing.source", kind="Enumeration", items={0: "plan", 1: "tail"})]
    return make_system(ports, SCENE, **more)


def flight(system, duration_s=10.0, *, seed=0):
    """Return the listener calls of a made-up flight, in order, as (call, arguments)."""
    rng = np.random.default_rng(seed)
    calls = [("parameters", (0, "mpc", {"height_agl_m": 10.0}))]
    held = {}
    for tick in range(round(duration_s * 20) + 1):
        time_ns = tick * TICK_NS
        for component, ports in system.ports.items():
            every = {"mpc": 10, "sensor": 1}.get(component, 1)
            if tick % every:
                continue
            renewed = component != "sensor" or tick % 8 == 0
            values = {
                p.name: _value(p, rng, tick) if renewed else held[str(p)]
                for p in ports.values()
                if p.causality == "output"
            }
            held |= {f"{component}.{name}": value for name, value in values.items()}
            calls.append(("outputs", (time_ns, component, values)))
            calls.append(("wall_clock", (time_ns, component, float(rng.uniform(0, 0.02)))))
    calls.append(("event", (time_ns, "end", "", "end of the scenario")))
    calls.append(("log", (time_ns, 20, "simulate", "landed")))
    return calls


def tell(listener, system, calls, result=None):
    """Tell a listener about a whole run."""
    listener.open(system)
    for call, arguments in calls:
        getattr(listener, call)(*arguments)
    end_ns = max(arguments[0] for _, arguments in calls)
    listener.close(result or Result("flown", "", end_ns, {"overruns.mpc": 3}, 1.5, 1.6))


def _value(each, rng, tick):
    if each.kind == "float":
        smooth = 100 * np.sin(0.01 * tick + rng.uniform(0, 0.01, each.shape or None))
        return smooth if each.shape else float(smooth)
    if each.kind == "boolean":
        return True
    if each.shape:
        return rng.integers(0, 2, each.shape)
    return 0 if each.items else tick
