"""Nonlinear 9-degree-of-freedom helicopter: six rigid-body and three rotor degrees of freedom.

Written once, on scalars and without a branch: plain Python as it stands. :func:`inject` rebinds the
four elementary functions, so the same text is compiled by numba or traced symbolically. Frames:
inertial NED, body FRD, 3-2-1 Euler angles. Rotor: flapping of first order with a stabiliser bar
(structure of Mettler, Tischler, Kanade, CMU-RI-TR-00-03), Glauert inflow, ground effect after
Cheeseman and Bennett.

State x (17)::

    north east down | u v w | phi theta psi | p q r | a b rotor | c d

a > 0 tilts the rotor disc aft (nose up), b > 0 to the right; c, d are the same angles of the
stabiliser bar. ``rotor`` is the thrust in G for the thrust-commanded plant and the induced velocity
in m/s for the collective one. Command u (4)::

    thrust (G) | pitch (rad) | roll (rad) | tail (G) or heading (rad)

Pitch and roll are the disc tilts a_c, b_c in actuator form and attitude set-points in attitude form.
"""

# pyright: basic
# arguments are scalars, tuples or symbols: untyped on purpose

from plant.elementary import nearest, select, sincos, sqrt

FLAP_STOP = 0.4363323129985824  # rad, 25 degrees: mechanical stop of a and b
NO_GROUND = -1.0e9  # m: elevation of a ground too far below to matter
PI = 3.141592653589793
TWO_PI = 6.283185307179586


def clip(x, low, high):
    """Limit x to [low, high] without a branch."""
    x = select(x < low, low, x)
    return select(x > high, high, x)


def actuators(x, u, p):
    """Return (thrust, a_c, b_c, tail): the command through the attitude stabiliser, clipped.

    ``actuator = direct c + trim + K (c - angle) - K_rate rate``; in actuator form all gains are zero
    and the command passes. The heading error is wrapped to [-pi, pi).
    """
    turn = u[3] - x[8]
    turn = turn - TWO_PI * nearest(turn / TWO_PI)
    a_c = p.direct * u[1] + p.a_trim + p.K_theta * (u[1] - x[7]) - p.K_q * x[10]
    b_c = p.direct * u[2] + p.b_trim + p.K_phi * (u[2] - x[6]) - p.K_p * x[9]
    tail = p.direct * u[3] + p.tail_trim + p.K_psi * turn - p.K_r * x[11]
    return (
        clip(u[0], p.thrust_min, p.thrust_max),
        clip(a_c, -p.tilt_max, p.tilt_max),
        clip(b_c, -p.tilt_max, p.tilt_max),
        clip(tail, -p.tail_max, p.tail_max),
    )


def inflow(T, V_t2, V_c, p):
    """Return the induced velocity v_i, m/s: Glauert's equation by four Newton steps.

    ``v_i sqrt(V_t^2 + (V_c + v_i)^2) = T / (2 rho A)``; 1e-9 under the root keeps it differentiable.
    """
    A = PI * p.radius * p.radius
    v_h2 = T / (2.0 * p.rho * A)
    v_i = v_h2 / sqrt(V_t2 + V_c * V_c + v_h2 + 1e-9)
    for _ in range(4):
        through = V_c + v_i
        s2 = V_t2 + through * through + 1e-9
        s = sqrt(s2)
        slope = s2 + v_i * through  # times s
        slope = select(slope < 0.2 * s2, 0.2 * s2, slope)
        v_i = v_i - (v_i * s - v_h2) * s / slope
        v_i = select(v_i < 0.0, 0.0, v_i)
    return v_i


def ground_effect(x, ground, V_t2, v_i, p):
    """Return the thrust augmentation k_GE of Cheeseman and Bennett at the hub's height."""
    z = -x[2] - ground + p.h
    z = select(z < 0.5 * p.radius, 0.5 * p.radius, z)
    return 1.0 / (1.0 - (p.radius / (4.0 * z)) ** 2 / (1.0 + V_t2 / (v_i * v_i + 1e-3)))


def hub_flow(x, air, p):
    """Return (u_h, v_h, n_x, n_y, n_z, V_c, V_t2): flow at the hub along and across the thrust axis."""
    u_h = air[0] - x[10] * p.h
    v_h = air[1] + x[11] * p.x_h + x[9] * p.h
    w_h = air[2] - x[10] * p.x_h
    s_a, c_a = sincos(clip(x[12], -FLAP_STOP, FLAP_STOP))
    s_b, c_b = sincos(clip(x[13], -FLAP_STOP, FLAP_STOP))
    t_a = s_a / c_a
    t_b = s_b / c_b
    length = sqrt(1.0 + t_a * t_a + t_b * t_b)
    n_x = -t_a / length
    n_y = t_b / length
    n_z = -1.0 / length
    V_c = u_h * n_x + v_h * n_y + w_h * n_z
    V_t2 = u_h * u_h + v_h * v_h + w_h * w_h - V_c * V_c
    return u_h, v_h, w_h, n_x, n_y, n_z, V_c, select(V_t2 < 0.0, 0.0, V_t2)


def body_from_ned(v, angles):
    """Return R' v for (sin, cos) of roll, pitch and yaw."""
    s_phi, c_phi, s_th, c_th, s_psi, c_psi = angles
    ahead = c_psi * v[0] + s_psi * v[1]
    right = c_psi * v[1] - s_psi * v[0]
    below = s_th * ahead + c_th * v[2]
    return c_th * ahead - s_th * v[2], c_phi * right + s_phi * below, c_phi * below - s_phi * right


def _limited(T, p):
    A = PI * p.radius * p.radius
    sigma = p.blades * p.chord / (PI * p.radius)
    stall = p.CT_sigma_max * sigma * p.rho * A * (p.Omega * p.radius) ** 2
    return select(stall < T, stall, T)


def rotor_power(T, v_i, V_c, V_t2, p):
    """Return the main rotor's power, W: induced, climb and profile."""
    A = PI * p.radius * p.radius
    sigma = p.blades * p.chord / (PI * p.radius)
    tip = p.Omega * p.radius
    profile = sigma * p.c_d0 / 8.0 * p.rho * A * tip**3 * (1.0 + 4.65 * V_t2 / (tip * tip))
    return T * (p.kappa * v_i + V_c) + profile


def airframe(x, a_c, b_c, tail, T, v_i, flow, air, angles, bias, p):
    """Return the sixteen derivatives that do not depend on how the rotor makes its thrust T, N."""
    _, _, _, u, v, w, _, _, _, P, q, r, a, b, _, c, d = x
    s_phi, c_phi, s_th, c_th, s_psi, c_psi = angles
    u_a, v_a, w_a = air
    u_h, v_h, w_h, n_x, n_y, n_z, V_c, V_t2 = flow
    half_rho = 0.5 * p.rho
    A = PI * p.radius * p.radius
    sigma = p.blades * p.chord / (PI * p.radius)
    tip = p.Omega * p.radius
    mu2 = V_t2 / (tip * tip)
    mu = sqrt(mu2 + 1e-300)

    power = rotor_power(T, v_i, V_c, V_t2, p)
    torque = select(power < 0.0, 0.0, power) / p.Omega
    H0 = sigma * p.c_d0 / 4.0 * p.rho * A * tip
    F_x = T * n_x - H0 * u_h
    F_y = T * n_y - H0 * v_h
    F_z = T * n_z
    L = p.K_b * clip(b, -FLAP_STOP, FLAP_STOP) + p.h * F_y
    M = p.K_b * clip(a, -FLAP_STOP, FLAP_STOP) - p.h * F_x - p.x_h * F_z
    N = p.x_h * F_y + p.ROT * torque

    # tail rotor
    v_t = v_a - p.l_t * r + p.h_t * P
    T_t = p.weight * (tail - p.K_gyro * r) + p.T_v * v_t - p.TQFF * p.ROT * torque / p.l_t
    F_y = F_y - T_t
    L = L - p.h_t * T_t
    N = N + p.l_t * T_t

    # fuselage in the rotor's wake
    w_f = w_a - v_i
    V_f = sqrt(u_a * u_a + v_a * v_a + w_f * w_f + 1e-9)
    F_x = F_x - half_rho * V_f * p.S_x * u_a
    F_y = F_y - half_rho * V_f * p.S_y * v_a
    F_z = F_z - half_rho * V_f * p.S_z * w_f

    # vertical fin and horizontal tail; |.| is smoothed
    along = sqrt(u_a * u_a + 1e-3)
    v_f = v_a - p.l_v * r + p.h_v * P
    stall = half_rho * p.S_v * 1.2 * (u_a * u_a + v_f * v_f)
    Y_f = -half_rho * p.S_v * (p.C_Lv * along + sqrt(v_f * v_f + 1e-3)) * v_f
    Y_f = clip(Y_f, -stall, stall)
    F_y = F_y + Y_f
    L = L + p.h_v * Y_f
    N = N - p.l_v * Y_f
    w_t = w_a + p.l_h * q
    stall = half_rho * p.S_h * 1.2 * (u_a * u_a + w_t * w_t)
    Z_t = -half_rho * p.S_h * (p.C_Lh * along + sqrt(w_t * w_t + 1e-3)) * w_t
    Z_t = clip(Z_t, -stall, stall)
    F_z = F_z + Z_t
    M = M + p.l_h * Z_t

    # rigid body
    d_x, d_y, d_z = body_from_ned(bias, angles)
    u_dot = F_x / p.mass - p.g * s_th + r * v - q * w + d_x
    v_dot = F_y / p.mass + p.g * s_phi * c_th + P * w - r * u + d_y
    w_dot = F_z / p.mass + p.g * c_phi * c_th + q * u - P * v + d_z
    # I omega_dot = M - omega x (I omega)
    L = L + (p.Iyy - p.Izz) * q * r + p.Ixz * P * q
    M = M + (p.Izz - p.Ixx) * P * r + p.Ixz * (r * r - P * P)
    N = N + (p.Ixx - p.Iyy) * P * q - p.Ixz * q * r
    determinant = p.Ixx * p.Izz - p.Ixz * p.Ixz
    p_dot = (p.Izz * L + p.Ixz * N) / determinant
    r_dot = (p.Ixz * L + p.Ixx * N) / determinant
    q_dot = M / p.Iyy

    # kinematics
    ahead = c_th * u + s_th * (s_phi * v + c_phi * w)
    right = c_phi * v - s_phi * w
    north_dot = c_psi * ahead - s_psi * right
    east_dot = s_psi * ahead + c_psi * right
    down_dot = -s_th * u + c_th * (s_phi * v + c_phi * w)
    safe = select(c_th < 0.0, -1.0, 1.0) * select(
        c_th * c_th < 1e-6, 1e-3, select(c_th < 0.0, -c_th, c_th)
    )
    turn = (s_phi * q + c_phi * r) / safe
    phi_dot = P + turn * s_th
    theta_dot = c_phi * q - s_phi * r

    # flapping and stabiliser bar
    C_T = T / (p.rho * A * tip * tip)
    through = (v_i + V_c) / tip
    theta0 = 3.0 * (2.0 * C_T / (p.a0 * sigma) + 0.5 * through)
    a_mu = 2.0 * p.K_mu * (4.0 / 3.0 * theta0 - through) / tip
    a_w = p.K_mu * 16.0 * mu2 / ((1.0 - 0.5 * mu2) * (8.0 * mu + p.a0 * sigma)) / tip
    pitch = p.k_a * a_c + p.bar * p.A_c * c
    roll = p.k_b * b_c + p.bar * p.B_d * d
    a_dot = -q + (-a + p.A_b * b + pitch + a_mu * u_h + a_w * w_h) / p.tau_f
    b_dot = -P + (-b + p.B_a * a + roll - a_mu * v_h) / p.tau_f
    c_dot = -p.bar * q - (c - (1.0 - p.k_a) * a_c / p.A_c) / p.tau_s
    d_dot = -p.bar * P - (d - (1.0 - p.k_b) * b_c / p.B_d) / p.tau_s
    return (
        north_dot, east_dot, down_dot, u_dot, v_dot, w_dot, phi_dot, theta_dot, turn,
        p_dot, q_dot, r_dot, a_dot, b_dot, c_dot, d_dot,
    )  # fmt: skip


def _relative_air(x, wind):
    s_phi, c_phi = sincos(x[6])
    s_th, c_th = sincos(x[7])
    s_psi, c_psi = sincos(x[8])
    angles = (s_phi, c_phi, s_th, c_th, s_psi, c_psi)
    w_x, w_y, w_z = body_from_ned(wind, angles)
    return (x[3] - w_x, x[4] - w_y, x[5] - w_z), angles


def derivative(x, u, wind, ground, bias, p):
    """Return the state's rate for the thrust-commanded plant (the paper's inputs).

    Parameters
    ----------
    x, u : tuples of 17 and 4
        State and command, module docstring.
    wind, bias : tuples of 3
        Velocity of the air, m/s, and unmodelled acceleration, m/s2; NED.
    ground : float
        Terrain elevation below, m.
    p : Constants
    """
    air, angles = _relative_air(x, wind)
    thrust, a_c, b_c, tail = actuators(x, u, p)
    flow = hub_flow(x, air, p)
    T = _limited(p.weight * select(x[14] < 0.0, 0.0, x[14]), p)
    v_i = inflow(T, flow[7], flow[6], p)
    T = T * ground_effect(x, ground, flow[7], v_i, p)
    rates = airframe(x, a_c, b_c, tail, T, v_i, flow, air, angles, bias, p)
    return (*rates[:14], (thrust - x[14]) / p.tau_T, *rates[14:])


def collective_thrust(x, u, wind, p):
    """Return (T, v_i, flow, air, angles, actuators): the collective rotor's thrust, N, and its flow.

    The allocation turns the commanded thrust into a collective angle, by blade-element theory at the
    steady inflow of that thrust and the *inertial* velocity: no air data. The same theory in the actual
    flow gives the thrust, so the blades answer a gust as real ones do.
    """
    air, angles = _relative_air(x, wind)
    act = actuators(x, u, p)
    flow = hub_flow(x, air, p)
    known = hub_flow(x, (x[3], x[4], x[5]), p)
    A = PI * p.radius * p.radius
    sigma = p.blades * p.chord / (PI * p.radius)
    tip = p.Omega * p.radius
    lift = 0.5 * p.rho * p.a0 * sigma * A * tip * tip
    T_c = _limited(p.weight * act[0], p)
    through = inflow(T_c, known[7], known[6], p) + known[6]
    theta0 = (T_c / lift + through / (2.0 * tip)) / (1.0 / 3.0 + 0.5 * known[7] / (tip * tip))
    v_i = select(x[14] < 0.0, 0.0, x[14])
    lever = 1.0 / 3.0 + 0.5 * flow[7] / (tip * tip)
    T = _limited(lift * (theta0 * lever - (v_i + flow[6]) / (2.0 * tip)), p)
    return T, v_i, flow, air, angles, act


def derivative_collective(x, u, wind, ground, bias, p):
    """Return the state's rate for the collective and pedal plant; arguments as :func:`derivative`.

    ``x[14]`` is the induced velocity, m/s, with the apparent mass of the air in the disc. The pedal
    enters linearly, so whatever its gain, its allocation is exact and cancels.
    """
    T, v_i, flow, air, angles, act = collective_thrust(x, u, wind, p)
    through = flow[6] + v_i
    A = PI * p.radius * p.radius
    momentum = 2.0 * p.rho * A * v_i * sqrt(flow[7] + through * through + 1e-9)
    v_i_dot = (T - momentum) / (8.0 / 3.0 * p.rho * p.radius**3)
    T = T * ground_effect(x, ground, flow[7], v_i, p)
    rates = airframe(x, act[1], act[2], act[3], T, v_i, flow, air, angles, bias, p)
    return (*rates[:14], v_i_dot, *rates[14:])
