"""acados: SQP with real-time iterations and partial condensing, generated C.

Written from its documentation and NOT RUN by us: it needs a build of acados and its template renderer,
which no wheel has. Expect to adapt a name; please report what it took.
"""

import numpy as np
from problems import TURN, Answer, Floats, Peer, Solve, states, traced

from paper.problem import Problem

CONDENSED = 20  # blocks of the partial condensing


def _solver(problem: Problem):
    import casadi as ca
    from acados_template import AcadosModel, AcadosOcp, AcadosOcpSolver

    plant = traced(problem)
    x, u = ca.SX.sym("x", 17), ca.SX.sym("u", 4)
    actuators, tracked = plant.actuators(x, u), plant.tracked(x)
    model = AcadosModel()
    model.name, model.x, model.u = "hedgehop", x, u
    model.disc_dyn_expr = plant.advance(x, u)
    model.cost_y_expr_0 = ca.vertcat(actuators, u)
    model.cost_y_expr = ca.vertcat(tracked, actuators, u)
    model.cost_y_expr_e = tracked
    model.con_h_expr_0 = model.con_h_expr = ca.vertcat(actuators[1:], u[3] - tracked[3])

    ocp = AcadosOcp()
    ocp.model = model
    ocp.cost.cost_type_0 = ocp.cost.cost_type = ocp.cost.cost_type_e = "NONLINEAR_LS"
    # its cost is half the weighted squares
    Q, R = 2.0 * np.array(problem.Q), 2.0 * np.array([*problem.R, *problem.Rc])
    ocp.cost.W_0, ocp.cost.W_e = np.diag(R), np.diag(Q)
    ocp.cost.W = np.diag([*Q, *R])
    ocp.cost.yref_0, ocp.cost.yref, ocp.cost.yref_e = np.zeros(8), np.zeros(13), np.zeros(5)
    rows = ocp.constraints
    rows.x0 = problem.state
    rows.idxbu = np.array([0, 1, 2])  # a heading has no bound
    rows.lbu, rows.ubu = problem.model.command_min[:3], problem.model.command_max[:3]
    rows.idxbx = rows.idxbx_e = np.array([6, 7])
    rows.ubx = rows.ubx_e = np.full(2, problem.attitude_limit)
    rows.lbx = rows.lbx_e = -rows.ubx
    rows.lh_0 = rows.lh = np.array([*problem.model.actuator_min[1:], -TURN])
    rows.uh_0 = rows.uh = np.array([*problem.model.actuator_max[1:], TURN])
    options = ocp.solver_options
    options.N_horizon = problem.horizon
    options.tf = float(problem.horizon)  # a time step of 1, which is what it scales the cost by
    options.integrator_type = "DISCRETE"
    options.nlp_solver_type = "SQP_RTI"
    options.hessian_approx = "GAUSS_NEWTON"
    options.qp_solver = "PARTIAL_CONDENSING_HPIPM"
    options.qp_solver_cond_N = CONDENSED
    return plant, AcadosOcpSolver(ocp, json_file="hedgehop_acados.json")


def _peer(ticks: int) -> Peer:
    def prepare(problem: Problem) -> Solve:
        plant, solver = _solver(problem)
        H = problem.horizon

        def solve(problem: Problem, u: Floats, again: bool) -> Answer:
            aims = np.hstack([np.tile(problem.actuators, (H, 1)), problem.commands.T])
            solver.set(0, "yref", aims[0])
            for k in range(1, H):
                solver.set(k, "yref", np.concatenate([problem.reference[:, k - 1], aims[k]]))
            solver.set(H, "yref", problem.reference[:, -1])
            solver.set(0, "lbx", problem.state)
            solver.set(0, "ubx", problem.state)
            if not again:
                solver.reset()
                for k, state in enumerate(states(problem, plant, u)):
                    solver.set(k, "x", state)
                for k, command in enumerate(u):
                    solver.set(k, "u", command)
            status = 0
            for _ in range(1 if again else ticks):
                status = solver.solve()
            found = np.array([solver.get(k, "u") for k in range(H)])
            return Answer(found, 1 if again else ticks, f"status {status}")

        return solve

    return Peer(f"acados SQP-RTI, {ticks} ticks", ("acados_template", "casadi"), prepare)


PEERS = (_peer(30),)
