"""do-mpc: its discrete model is the traced sample; its own NLP, its own IPOPT."""

import warnings

import numpy as np
from problems import ITERATIONS, TURN, Answer, Floats, Peer, Solve, states, traced

from paper.problem import Problem


def prepare(problem: Problem) -> Solve:
    """Build the model and the controller."""
    import casadi as ca

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # optional features that are not installed
        import do_mpc
    warnings.filterwarnings("ignore", category=FutureWarning, module="casadi")  # of its own calls

    plant, H = traced(problem), problem.horizon
    # SX would be expanded over the whole horizon
    model = do_mpc.model.Model("discrete", "MX")
    x, u = model.set_variable("_x", "x", (17, 1)), model.set_variable("_u", "u", (4, 1))
    reference = model.set_variable("_tvp", "reference", (5, 1))
    aim = model.set_variable("_tvp", "aim", (4, 1))
    tracks = model.set_variable("_tvp", "tracks")  # 0 at the start, which nothing can change
    model.set_rhs("x", plant.advance(x, u))
    model.setup()

    def squares(errors, weights):
        return ca.dot(ca.DM(weights), errors**2)

    mpc = do_mpc.controller.MPC(model)
    mpc.settings.n_horizon, mpc.settings.t_step = H, problem.model.sample_period
    mpc.settings.n_robust, mpc.settings.store_full_solution = 0, False
    mpc.settings.nlpsol_opts = {
        "ipopt.linear_solver": "mumps", "ipopt.max_iter": ITERATIONS, "ipopt.tol": 1e-8,
        "ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": 0,
    }  # fmt: skip
    off = squares(plant.tracked(x) - reference, problem.Q)
    actuators = plant.actuators(x, u)
    held = squares(actuators - problem.actuators, problem.R) + squares(u - aim, problem.Rc)
    mpc.set_objective(lterm=tracks * off + held, mterm=off)
    mpc.set_rterm(u=np.zeros((4, 1)))
    low, high = problem.model.actuator_min, problem.model.actuator_max
    mpc.bounds["lower", "_u", "u"] = problem.model.command_min
    mpc.bounds["upper", "_u", "u"] = problem.model.command_max
    tilt = np.full(17, np.inf)
    tilt[6:8] = problem.attitude_limit
    mpc.bounds["lower", "_x", "x"], mpc.bounds["upper", "_x", "x"] = -tilt, tilt
    # the thrust's actuator is its command
    mpc.set_nl_cons("above", actuators[1:], ub=high[1:])
    mpc.set_nl_cons("below", -actuators[1:], ub=-low[1:])
    turn = u[3] - plant.tracked(x)[3]
    mpc.set_nl_cons("right", turn, ub=TURN)
    mpc.set_nl_cons("left", -turn, ub=TURN)
    template = mpc.get_tvp_template()
    mpc.set_tvp_fun(lambda _: template)
    mpc.setup()

    def solve(problem: Problem, u: Floats, again: bool) -> Answer:
        for k in range(H + 1):
            template["_tvp", k, "reference"] = problem.reference[:, max(k - 1, 0)]
            template["_tvp", k, "aim"] = problem.commands[:, min(k, H - 1)]
            template["_tvp", k, "tracks"] = float(k > 0)
        if not again:
            mpc.reset_history()
            mpc.flags["initial_run"] = False  # no multipliers of another start
            mpc.x0, mpc.u0 = problem.state, u[0]
            mpc.set_initial_guess()
            for k, state in enumerate(states(problem, plant, u)):
                mpc.opt_x_num["_x", k, 0, -1] = state
            for k, command in enumerate(u):
                mpc.opt_x_num["_u", k, 0] = command
        mpc.make_step(problem.state)
        found = np.array([mpc.opt_x_num["_u", k, 0].full().ravel() for k in range(H)])
        status = mpc.solver_stats
        return Answer(found, int(status["iter_count"]), str(status["return_status"]))

    return solve


PEERS = (Peer("do-mpc", ("do_mpc", "casadi"), prepare),)
