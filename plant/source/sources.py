"""What an FMU of the helicopter without Python is made of: its description and its files."""

from collections.abc import Mapping
from dataclasses import replace
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant.dynamics import FLAP_STOP, NO_GROUND
from plant.helicopter_variables import ACTUATOR, AXES, STATE, helicopter_variables
from plant.lanes import ATTITUDE_LIMIT
from plant.r50 import Constants
from plant.rotorcraft import SAMPLE_PERIOD, Rotorcraft, rotorcraft
from plant.source.equations import equations
from plant.start import HelicopterParameters, starting_command, starting_state
from plant.terrain import Terrain, TerrainGrid
from plant.variables import Variable, model_description, parameter_variables

TEXTS = ("preset", "command", "rotor", "bounds")


class Source(NamedTuple):
    """An FMU in the making.

    ``description`` is FMPy's. ``sources``: name -> text; every ``.c`` is a unit to compile, next to
    the front end and ``model.h``. ``resources``: name -> content.
    """

    description: Any
    sources: Mapping[str, str]
    resources: Mapping[str, bytes]


def helicopter_source(parameters: HelicopterParameters, terrain: Terrain | None) -> Source:
    """Return the C sources of a vehicle: the variables of the native one, and these.

    * ``bias.*``, inputs: unmodelled acceleration, as the offset-free prediction needs it.
    * ``measured.*`` and ``restart``, inputs: where ``restart`` is true, the flight (at
      initialization) or the next step starts from ``measured`` and not from where the last step
      ended. So a prediction starts from any state, between any two steps, within what FMI permits;
      like the native model's it has no end: it goes on below the ground, and ``valid`` says
      whether all was well since the restart.
    * ``applied.*``, outputs: the actuators at the start of the last step, as a prediction has them.
    * ``perturbation.*``, parameters. The start is trimmed in C, so that all numbers are parameters.
    * The texts (preset, command form, ...) are string parameters that refuse another value: the
      equations are folded for them.

    Directional derivatives, exact: outputs after a step by ``command``, ``wind``, ``bias`` and
    ``measured`` as they acted in that step, ``measured`` standing for the state at its beginning
    whether ``restart`` was set or not: columns of the step's Jacobian. After initialization the last
    step is the empty one. Where the flight was over, it is the last step flown.

    Raises
    ------
    ValueError
        If CasADi is missing, or the start is impossible.
    """
    craft = rotorcraft(parameters, terrain)
    rows = source_variables(parameters, craft, starting_state(parameters, craft, terrain))
    description = model_description(
        "Helicopter", "Yamaha R-50, nonlinear, 9 degrees of freedom; C", rows, has_state=True
    )
    description.coSimulation.providesDirectionalDerivative = True
    description.coSimulation.fixedInternalStepSize = SAMPLE_PERIOD
    here = files("plant.source")
    return Source(
        description,
        {
            "helicopter.c": here.joinpath("helicopter.c").read_text(),
            "helicopter.h": _numbers(parameters, terrain is not None),
            "terrain.h": here.joinpath("terrain.h").read_text(),
            "equations.h": equations(craft),
        },
        {} if terrain is None else {"terrain.bin": terrain_bytes(terrain.grid)},
    )


def source_variables(
    parameters: HelicopterParameters, craft: Rotorcraft, start: NDArray[np.float64]
) -> list[Variable]:
    """Return the rows of the description, :func:`helicopter_source`."""
    rows = helicopter_variables(craft, starting_command(parameters, craft))
    states = {row.name: row for row in rows if row.name in STATE}
    first_output = next(i for i, row in enumerate(rows) if row.causality == "output")
    return [
        *rows[:first_output],
        *(
            Variable(f"bias.{axis}", "input", "m/s2", f"unmodelled acceleration, {axis}")
            for axis in AXES
        ),
        *(
            replace(
                states[name],
                name=name.replace("state", "measured"),
                causality="input",
                description=f"{states[name].description}, where restart is true",
                start=value,
            )
            for name, value in zip(STATE, start.tolist(), strict=True)
        ),
        Variable("restart", "input", "1", "the next step starts from measured", start=False),
        *rows[first_output:],
        *(
            replace(
                row,
                name=row.name.replace("actuator", "applied"),
                description="actuator at the start of the last step",
            )
            for row in rows
            if row.name in ACTUATOR
        ),
        *parameter_variables(parameters),
        *(
            replace(row, name=f"perturbation.{row.name}", description="added to the start")
            for row in parameter_variables(parameters.perturbation)
        ),
        *(
            Variable(name, "parameter", "1", "built in", getattr(parameters, name),
                     variability="fixed")
            for name in TEXTS
        ),
    ]  # fmt: skip


def terrain_bytes(grid: TerrainGrid) -> bytes:
    """Return ``terrain.bin``: little-endian doubles, layout in ``terrain.h``."""
    head = (*grid.coefficients.shape, *grid[1:])
    return np.concatenate([head, grid.coefficients.ravel()]).astype("<f8").tobytes()


def _numbers(parameters: HelicopterParameters, over_terrain: bool) -> str:
    """Return ``helicopter.h``."""
    texts = ", ".join(f'{{AT_{name}, "{name}", "{getattr(parameters, name)}"}}' for name in TEXTS)
    defines = {
        "STEP": repr(SAMPLE_PERIOD),
        "NO_GROUND": f"({NO_GROUND!r})",
        "FLAP_STOP": repr(FLAP_STOP),
        "ATTITUDE_LIMIT": repr(ATTITUDE_LIMIT),
        "NOMINAL_MASS": repr(Constants().mass),
        "ATTITUDE_FORM": str(int(parameters.command == "attitude")),
        "OVER_TERRAIN": str(int(over_terrain)),
        "TEXTS": f"{{{texts}}}",
    }
    text = "".join(f"#define {name} {value}\n" for name, value in defines.items())
    return f"/* Numbers of this export. */\n{text}"
