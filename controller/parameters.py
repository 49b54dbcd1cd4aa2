"""The parameters of the control-basis-function MPC, and the design that follows from them."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Interval

from controller.bases import span_basis
from controller.learned import learned_basis, read_basis
from controller.optimise import Design, Improve, optimise
from controller.prediction import (
    Floats,
    Identification,
    PredictionModel,
    linearise_of,
    stack_bases,
)
from controller.reference import ReferenceParameters
from controller.tracking import Weights

Family = Literal[
    "laguerre", "laguerre_function", "legendre", "chebyshev", "tent", "ramp", "box", "bspline", "full",
    "learned",
]  # fmt: skip
Four = tuple[float, float, float, float]
TUNABLE = (
    "speed_mps", "height_agl_m", "north_weight", "east_weight", "altitude_weight", "heading_weight",
    "speed_weight",
)  # fmt: skip
"""Parameters that may change in flight."""

_AMPLITUDE = {"thrust": 2e-4, "pitch": 1e-4, "roll": 1e-4, "tail": 1e-5, "heading": 1e-4}
"""Perturbations of the identification, G and rad: tiny, yet large against rounding."""


@dataclass(frozen=True)
class MpcParameters:
    """The controller's design. Q weighs outputs, R actuators; names in words, units in the suffix."""

    waypoints_m: Annotated[
        tuple[tuple[float, float], ...], "course: north and east of every way-point"
    ] = ((0.0, 0.0), (2000.0, 0.0))
    speed_mps: Annotated[float, Gt(0), "speed to hold over ground"] = 30.0
    height_agl_m: Annotated[float, Gt(0), "height above ground to hold"] = 10.0
    basis: Annotated[Family, "family of control basis functions"] = "laguerre"
    bases_per_channel: Annotated[
        int | tuple[int, int, int, int],
        "number of functions, for all channels or for each; learned ones act on all: 4 n of them",
    ] = 5
    basis_file: Annotated[Path | None, "of a learned basis, by `hedgehop learn-basis`"] = None
    laguerre_time: Annotated[
        Literal["seconds", "normalised"], "argument of the Laguerre polynomials"
    ] = "seconds"
    pole_per_s: Annotated[float, Gt(0), "pole of the Laguerre functions"] = 0.5
    identification: Annotated[
        Identification,
        "perturbed rollouts, or recursion along one, whose cost hardly depends on the basis",
    ] = "rollouts"
    horizon_s: Annotated[float, Gt(0), "longest horizon"] = 10.0
    adapt_horizon: Annotated[bool, "shorten the horizon to the terrain sensed"] = True
    horizon_quantum_s: Annotated[float, Gt(0), "horizons are multiples of this"] = 0.5
    north_weight: Annotated[float, Ge(0), "Q on position north"] = 1.0
    east_weight: Annotated[float, Ge(0), "Q on position east"] = 1.0
    altitude_weight: Annotated[float, Ge(0), "omega: Q on altitude"] = 10.0
    heading_weight: Annotated[float, Ge(0), "Q on heading"] = 10.0
    speed_weight: Annotated[float, Ge(0), "Q on speed"] = 1.0
    actuator_weights: Annotated[Four, "R on thrust, pitch, roll, tail minus trim"] = (
        0.1, 1.0, 1.0, 1.0,
    )  # fmt: skip
    command_weights: Annotated[Four, "R on set-points minus trim, in attitude form"] = (
        0.0, 0.1, 0.1, 0.1,
    )  # fmt: skip
    attitude_limit_deg: Annotated[
        float, Interval(gt=0, lt=80), "limit of roll and pitch in a plan"
    ] = 50.0
    heading_limit_deg: Annotated[
        float, Interval(gt=0, lt=180), "limit of the heading's deviation in a plan"
    ] = 30.0
    heading_set_point_limit_deg: Annotated[
        float, Interval(gt=0, lt=180), "limit of the heading set-point's deviation in a plan"
    ] = 50.0
    clearance_min_m: Annotated[float, Ge(0), "soft limit of the clearance in a plan"] = 5.0
    clearance_penalty: Annotated[
        tuple[float, float],
        "linear and quadratic weight of the slack that all clearance rows share",
    ] = (2e3, 2e2)
    corridor_m: Annotated[
        float, Ge(0), "half width within which the course may follow the least gradient"
    ] = 0.0
    smoothing_m4: Annotated[float, Ge(0), "weight of the reference's squared curvature"] = 1e4
    solver: Annotated[Literal["daqp", "piqp", "cvxpy"], "solver of the quadratic programme"] = (
        "daqp"
    )
    line_search: Annotated[bool, "search the step length on the nonlinear model"] = True
    passes_at_start: Annotated[int, Ge(1), "passes at the first update, from a cold start"] = 5
    bias_estimate: Annotated[bool, "estimate an acceleration bias (offset-free tracking)"] = True
    compensate_latency: Annotated[bool, "predict to the instant the plan takes effect"] = True
    wind_mps: Annotated[tuple[float, float, float], "known steady wind, north, east, down"] = (
        0.0,
        0.0,
        0.0,
    )
    plan_capacity: Annotated[int, Ge(1), "samples in a plan"] = 200
    scan_capacity: Annotated[int, Ge(1), "cells in a scan's ring"] = 4500


def reference_parameters(p: MpcParameters) -> ReferenceParameters:
    """Return what the reference should be like."""
    return ReferenceParameters(
        speed_mps=p.speed_mps,
        height_agl_m=p.height_agl_m,
        corridor_m=p.corridor_m,
        smoothing_m4=p.smoothing_m4,
    )


def weights(p: MpcParameters, *, attitude_form: bool) -> Weights:
    """Return the weights and limits of the cost."""
    return Weights(
        Q=(p.north_weight, p.east_weight, p.altitude_weight, p.heading_weight, p.speed_weight),
        R=p.actuator_weights,
        Rc=p.command_weights if attitude_form else (0.0, 0.0, 0.0, 0.0),
        attitude_limit=float(np.radians(p.attitude_limit_deg)),
        heading_limit=float(np.radians(p.heading_limit_deg)),
        clearance=p.clearance_min_m,
        rho1=p.clearance_penalty[0],
        rho2=p.clearance_penalty[1],
    )


def design(p: MpcParameters, model: PredictionModel, horizon: int) -> Design:
    """Return the design for a horizon of H samples.

    A learned basis is that of the parameters' speed: one that is tuned in flight does not change it.

    Raises
    ------
    ValueError
        If the basis does not exist at that horizon or has no file, or the model has no tangent and
        is to be identified by recursion.
    """
    if p.identification == "recursion":
        linearise_of(model)
    return Design(
        model=model,
        Phi=_columns(p, model, horizon),
        amplitude=np.array([_AMPLITUDE[name] for name in model.commands]),
        wind=np.array(p.wind_mps),
        backend=p.solver,
        line_search=p.line_search,
        identification=p.identification,
    )


def _columns(p: MpcParameters, model: PredictionModel, horizon: int) -> Floats:
    """Return Phi, (4, H, m)."""
    counts = p.bases_per_channel
    counts = (counts,) * 4 if isinstance(counts, int) else counts
    if p.basis == "learned":
        if p.basis_file is None:
            raise ValueError(
                "basis learned: no file, got basis_file null, "
                "expected one written by `hedgehop learn-basis`"
            )
        return learned_basis(
            read_basis(p.basis_file),
            horizon,
            sum(counts),
            speed=p.speed_mps,
            commands=tuple(model.commands),
            sample_period=model.sample_period,
        )
    bases = [
        span_basis(
            p.basis,
            horizon,
            horizon if p.basis == "full" else count,
            sample_period=model.sample_period,
            time=p.laguerre_time,
            pole_per_s=p.pole_per_s,
        )[0]
        for count in counts
    ]
    return stack_bases(bases)


def basis_planner(p: MpcParameters, model: PredictionModel, horizon: int) -> Improve:
    """Return the pass of :func:`optimise` with the design of a horizon of H samples."""
    return partial(optimise, design(p, model, horizon))
