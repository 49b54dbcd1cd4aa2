"""The equations of a helicopter as C functions, traced by CasADi from the one model source.

Structure (preset, command form, rotor, bounds) is folded into numbers. What an export's parameters
move is an argument: ``VARIED``, the last of what is held over a step::

    k (16) = command (4) | wind (3) | bias (3) | ground | mass TQFF a_trim b_trim tail_trim
"""

# pyright: basic
# arguments are scalars, tuples or symbols: untyped on purpose

from collections.abc import Callable
from typing import Any

from plant.rotorcraft import ROTOR, Rotorcraft
from plant.symbolic import casadi, scalars, traced, traced_trim

STATES = 17
HELD = 16
VARIED = ("mass", "TQFF", "a_trim", "b_trim", "tail_trim")
_STILL = (0.0, 0.0, 0.0)


def equations(craft: Rotorcraft) -> str:
    """Return C text with these functions of columns, each with CasADi's calling sequence.

    ========================  =================================================================
    ``rates(x, k)``           rate of the plant's own state (17)
    ``readings(x, k)``        thrust G, velocity NED (3), actuators (4), load factor g (9)
    ``applied(x, k)``         actuators (4)
    ``own_state(common, k)``  the plant's own state (17) from the published one
    ``guess(q)``              ``z`` (8) near the trim, q = (speed, mass, TQFF)
    ``newton(z, q)``          the next ``z``, the unbalance (8) and the common state (17) of this one
    ``body(v, angles)``       body components (3) of a NED vector, angles = (phi, theta, psi)
    ========================  =================================================================

    The first four have a twin, ``rates_tangent`` and so on, which takes and returns each column
    followed by its tangent: CasADi's forward differentiation, exact.
    """
    ca = casadi()
    moving = {
        "rates": _rates(craft),
        "readings": _readings(craft),
        "applied": _applied(craft),
        "own_state": _own_state(craft),
    }
    made = [
        *(_function(name, of, STATES, HELD) for name, of in moving.items()),
        *(_tangent(f"{name}_tangent", of, STATES, HELD) for name, of in moving.items()),
        *_trim(craft),
        _function("body", _body, 3, 3),
    ]
    generator = ca.CodeGenerator("equations", {"casadi_int": "int"})
    for function in made:
        generator.add(function)
    return generator.dump()


Equation = Callable[[Any, Any], tuple[Any, ...]]


def _function(name: str, equation: Equation, *sizes: int) -> Any:
    ca = casadi()
    columns = [ca.SX.sym(f"c{i}", size) for i, size in enumerate(sizes)]
    return ca.Function(name, columns, [ca.vertcat(*equation(*columns))], {"cse": True})


def _tangent(name: str, equation: Equation, *sizes: int) -> Any:
    ca = casadi()
    columns = [ca.SX.sym(f"c{i}", 2 * size) for i, size in enumerate(sizes)]
    at = [column[:size] for column, size in zip(columns, sizes, strict=True)]
    along = [column[size:] for column, size in zip(columns, sizes, strict=True)]
    value = ca.vertcat(*equation(*at))
    tangent = ca.jtimes(value, ca.vertcat(*at), ca.vertcat(*along))
    return ca.Function(name, columns, [ca.vertcat(value, tangent)], {"cse": True})


def _held(craft: Rotorcraft, k: Any) -> tuple[Any, ...]:
    """Return (command, wind, bias, ground, constants) of what is held."""
    values = scalars(k)
    p = craft.p._replace(**dict(zip(VARIED, values[11:], strict=True)))
    return values[:4], values[4:7], values[7:10], values[10], p


def _rates(craft: Rotorcraft) -> Equation:
    of = traced().derivative_collective if craft.collective else traced().derivative

    def rates(x: Any, k: Any) -> tuple[Any, ...]:
        u, wind, bias, ground, p = _held(craft, k)
        return of(scalars(x), u, wind, ground, bias, p)

    return rates


def _readings(craft: Rotorcraft) -> Equation:
    model = traced()

    def readings(state: Any, k: Any) -> tuple[Any, ...]:
        ca = casadi()
        x = scalars(state)
        u, wind, _, ground, p = _held(craft, k)
        if craft.collective:
            rate = model.derivative_collective(x, u, wind, ground, _STILL, p)
            thrust = model.collective_thrust(x, u, wind, p)[0] / p.weight
        else:
            rate = model.derivative(x, u, wind, ground, _STILL, p)
            thrust = x[ROTOR]
        gravity = p.g * ca.cos(x[6]) * ca.cos(x[7])
        load = (gravity + x[10] * x[3] - x[9] * x[4] - rate[5]) / p.g
        return thrust, *rate[:3], *model.actuators(x, u, p), load

    return readings


def _applied(craft: Rotorcraft) -> Equation:
    model = traced()

    def applied(x: Any, k: Any) -> tuple[Any, ...]:
        u, _, _, _, p = _held(craft, k)
        return model.actuators(scalars(x), u, p)

    return applied


def _own_state(craft: Rotorcraft) -> Equation:
    model = traced()

    def own_state(common: Any, k: Any) -> tuple[Any, ...]:
        p = _held(craft, k)[-1]
        x = list(scalars(common))
        if craft.collective:
            flow = model.hub_flow(x, x[3:6], p)
            thrust = p.weight * casadi().fmax(x[ROTOR], 0.0)
            x[ROTOR] = model.inflow(thrust, flow[7], flow[6], p)
        return tuple(x)

    return own_state


def _trim(craft: Rotorcraft) -> list[Any]:
    ca, model = casadi(), traced_trim()
    z, q = ca.SX.sym("z", 8), ca.SX.sym("q", 3)
    speed, mass, feedforward = scalars(q)
    p = craft.p._replace(mass=mass, TQFF=feedforward)
    unbalance = ca.vertcat(*model.unbalance(scalars(z), speed, p, model.dynamics.NO_GROUND))
    following = z - ca.solve(ca.jacobian(unbalance, z), unbalance)
    state = ca.vertcat(*model.level(scalars(z), speed, p)[0])
    return [
        ca.Function("guess", [q], [ca.vertcat(*model.first_guess(speed, p))]),
        ca.Function("newton", [z, q], [following, unbalance, state], {"cse": True}),
    ]


def _body(v: Any, angles: Any) -> tuple[Any, ...]:
    model = traced()
    phi, theta, psi = (model.sincos(angle) for angle in scalars(angles))
    return model.body_from_ned(scalars(v), (*phi, *theta, *psi))
