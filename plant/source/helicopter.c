/* The helicopter as a back end of an FMU: the C twin of plant/helicopter.py.
 *
 * Every formula of the model is in equations.h, traced from plant/dynamics.py; here are the
 * Runge-Kutta steps, the start, the readings, and derivatives of a step. helicopter.h has the numbers
 * of this export. Nothing is static but constants: instances share nothing. */
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__)
#pragma GCC optimize("fp-contract=off") /* the same numbers on every processor */
#elif defined(_MSC_VER)
#pragma fp_contract(off)
#endif

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "backend.h"
#include "model.h"

#include "helicopter.h"
#include "terrain.h"

#define CASADI_SYMBOL_EXPORT static inline
#ifdef __GNUC__
#pragma GCC visibility push(hidden)
#endif
#include "equations.h"
#ifdef __GNUC__
#pragma GCC visibility pop
#endif

enum { NX = 17, NK = 16, NR = 9 }; /* state, what is held over a step, readings */
enum { WIND = 4, BIAS = 7, GROUND = 10, VARIED = 11, ROTOR = 14 };
enum { OK = 0, ERROR = 3 };
enum { FLYING, COLLISION, DEPARTED, LEFT_TERRAIN };

/* the groups lie in the values without a gap */
typedef char groups_are_dense[AT_wind_down - AT_wind_north == 2 && AT_bias_down - AT_bias_north == 2 &&
                              AT_measured_d - AT_measured_north == NX - 1 &&
                              AT_state_d - AT_state_north == NX - 1 &&
                              AT_pose_psi - AT_pose_north == 5 &&
                              AT_velocity_down - AT_velocity_north == 2 &&
                              AT_actuator_tail - AT_actuator_thrust == 3 &&
                              AT_applied_tail - AT_applied_thrust == 3 ? 1 : -1];

typedef struct { /* everything that decides the future, and the last step for its derivatives */
    double x[NX];
    double before[NX], common[NX]; /* at the last step's start: the plant's own and the published state */
    double held[NK];
    int64_t substeps, flown, valid; /* flown: of the last step, 0 at the start */
    int64_t endless;                /* a prediction: restarted between steps */
} State;

struct Backend {
    State now;
    Terrain terrain;
    LogFunction log;
    void *environment;
};

typedef int Equation(const double **, double **, int *, double *, int);

static void evaluate(Equation *equation, const double *x, const double *k, double *out) {
    const double *arguments[2];
    arguments[0] = x;
    arguments[1] = k;
    equation(arguments, &out, NULL, NULL, 0);
}

static int fail(Backend *b, const char *format, ...) {
    char text[400];
    va_list rest;
    va_start(rest, format);
    vsnprintf(text, sizeof text, format, rest);
    va_end(rest);
    b->log(b->environment, ERROR, "logStatusError", text);
    return ERROR;
}

/* Return the elevation below, 0 where this export has no terrain. */
static double elevation(const Backend *b, const double *x, double slope[2]) {
    slope[0] = slope[1] = 0.0;
    return OVER_TERRAIN ? terrain_height(&b->terrain, x[0], x[1], slope) : 0.0;
}

static double felt(double z) { return OVER_TERRAIN && !isnan(z) ? z : NO_GROUND; }

/* Do classical Runge-Kutta steps with n = NX, or n = 2 NX where tangents follow the state. */
static void advance(Equation *rates, int n, double *x, const double *k, int64_t substeps) {
    static const double reach[4] = {0.5, 0.5, 1.0, 0.0}, weight[4] = {1.0, 2.0, 2.0, 1.0};
    const double h = STEP / (double)substeps;
    double at[2 * NX], sum[2 * NX], rate[2 * NX];
    int64_t step;
    int stage, i;
    for (step = 0; step < substeps; step++) {
        for (i = 0; i < n; i++) at[i] = x[i], sum[i] = 0.0;
        for (stage = 0; stage < 4; stage++) {
            evaluate(rates, at, k, rate);
            for (i = 0; i < n; i++) {
                sum[i] += weight[stage] * rate[i];
                at[i] = x[i] + reach[stage] * h * rate[i];
            }
        }
        for (i = 0; i < n; i++) x[i] += h / 6.0 * sum[i];
        for (i = 12; i < 14; i++) { /* the flapping angles' stop */
            if (fabs(x[i]) > FLAP_STOP) {
                x[i] = copysign(FLAP_STOP, x[i]);
                if (n > NX) x[NX + i] = 0.0;
            }
        }
    }
}

static void hold_inputs(Backend *b, const Values *v) {
    memcpy(b->now.held, v->reals + AT_command_thrust, 4 * sizeof(double));
    memcpy(b->now.held + WIND, v->reals + AT_wind_north, 3 * sizeof(double));
    memcpy(b->now.held + BIAS, v->reals + AT_bias_north, 3 * sizeof(double));
}

/* Take a published state for the plant's own. */
static void take_state(Backend *b, const double *common) {
    State *now = &b->now;
    memcpy(now->common, common, sizeof now->common);
    evaluate(own_state, now->common, now->held, now->x);
    memcpy(now->before, now->x, sizeof now->before);
}

/* Write the outputs, from the state and what was held. */
static void read_out(Backend *b, Values *v) {
    const double *x = b->now.x;
    double k[NK], r[NR], slope[2], sum = 0.0, *reals = v->reals;
    const double z = elevation(b, x, slope), clearance = -x[2] - z;
    int i, level = fabs(x[6]) <= ATTITUDE_LIMIT && fabs(x[7]) <= ATTITUDE_LIMIT;
    memcpy(k, b->now.held, sizeof k);
    k[GROUND] = felt(z);
    evaluate(readings, x, k, r);
    for (i = 0; i < NX; i++) sum += x[i];
    memcpy(reals + AT_state_north, x, NX * sizeof(double));
    reals[AT_state_north + ROTOR] = r[0];
    memcpy(reals + AT_pose_north, x, 3 * sizeof(double));
    memcpy(reals + AT_pose_phi, x + 6, 3 * sizeof(double));
    memcpy(reals + AT_velocity_north, r + 1, 3 * sizeof(double));
    memcpy(reals + AT_actuator_thrust, r + 4, 4 * sizeof(double));
    reals[AT_clearance] = isnan(clearance) ? -x[2] : clearance;
    reals[AT_load_factor] = r[8];
    v->integers[AT_outcome] = !(level && isfinite(sum)) ? DEPARTED
                              : isnan(clearance)        ? LEFT_TERRAIN
                              : clearance <= 0.0        ? COLLISION
                                                        : FLYING;
    v->integers[AT_valid] = b->now.valid;
}

/* Find level flight by Newton's method: the common state, heading north at altitude 0, and z. */
static int trim(Backend *b, const double q[3], double z[8], double state[NX]) {
    double next[8], unbalance[8], worst = INFINITY, moved = INFINITY;
    const double *arguments[2];
    double *results[3];
    int i, turn;
    evaluate(guess, q, NULL, z);
    arguments[0] = z, arguments[1] = q;
    results[0] = next, results[1] = unbalance, results[2] = state;
    for (turn = 0; turn < 30 && moved > 1e-15; turn++) {
        newton(arguments, results, NULL, NULL, 0);
        for (i = 0, worst = 0.0, moved = 0.0; i < 8; i++) {
            worst = fmax(worst, isnan(unbalance[i]) ? INFINITY : fabs(unbalance[i]));
            moved = fmax(moved, fabs(next[i] - z[i]));
        }
        memcpy(z, next, sizeof next);
    }
    if (worst <= 1e-8) return OK;
    return fail(b, "trim: no level flight found, got speed %g m/s, expected 0 to 35 m/s", q[0]);
}

/* Set the constants that parameters move: mass, feed-forward, the stabiliser's trim. */
static int set_constants(Backend *b, const Values *v) {
    double z[8], state[NX], q[3], *varied = b->now.held + VARIED;
    const int64_t *flags = v->integers;
    memset(varied, 0, (NK - VARIED) * sizeof(double));
    varied[0] = v->reals[AT_mass_kg];
    varied[1] = flags[AT_torque_feedforward] ? 1.0 : 0.0;
    b->now.substeps = flags[AT_substeps];
    if (!(varied[0] > 0.0)) return fail(b, "mass_kg: got %g kg, expected above 0 kg", varied[0]);
    if (b->now.substeps < 1) return fail(b, "substeps: got %ld, expected 1 or more",
                                         (long)b->now.substeps);
    if (!ATTITUDE_FORM) return OK;
    q[0] = v->reals[AT_stabiliser_speed_mps], q[1] = NOMINAL_MASS, q[2] = 0.0;
    if (trim(b, q, z, state) != OK) return ERROR;
    varied[2] = z[1], varied[3] = z[2], varied[4] = z[3];
    return OK;
}

/* Put a flight at its start: trimmed over the terrain, perturbed if asked (plant/start.py). */
static int starting_state(Backend *b, const Values *v, double state[NX]) {
    const double *reals = v->reals, *delta = reals + AT_perturbation_north_m;
    const double radian = 0.017453292519943295, heading = radian * reals[AT_heading_deg];
    const double height = reals[AT_height_agl_m] + delta[2], speed = reals[AT_speed_mps];
    double q[3], z[8], ahead[3], angles[3], ground, slope[2], climb = 0.0;
    q[0] = speed, q[1] = b->now.held[VARIED], q[2] = b->now.held[VARIED + 1];
    if (trim(b, q, z, state) != OK) return ERROR;
    state[0] = reals[AT_north_m] + delta[0];
    state[1] = reals[AT_east_m] + delta[1];
    ground = elevation(b, state, slope);
    if (isnan(ground))
        return fail(b, "terrain: point outside or without data, got north %g m, east %g m",
                    state[0], state[1]);
    if (!(height > 0.0))
        return fail(b, "height_agl_m: start below ground, got height %g m, expected above 0 m",
                    height);
    if (v->integers[AT_slope_matched])
        climb = atan(slope[0] * cos(heading) + slope[1] * sin(heading));
    state[2] = -(ground + height);
    state[6] += radian * delta[6];
    state[7] += radian * delta[7];
    state[8] = heading + radian * delta[8];
    ahead[0] = speed * cos(climb) + delta[3];
    ahead[1] = delta[4];
    ahead[2] = -speed * sin(climb) - delta[5];
    angles[0] = state[6], angles[1] = state[7], angles[2] = radian * delta[8];
    evaluate(body, ahead, angles, state + 3);
    return OK;
}

Backend *backend_new(const char *instance_name, const char *resource_folder, LogFunction log,
                     void *environment) {
    Backend *b = calloc(1, sizeof *b);
    (void)instance_name;
    if (!b) return NULL;
    b->log = log;
    b->environment = environment;
    if (OVER_TERRAIN) {
        const char *folder = resource_folder ? resource_folder : ".", *problem;
        const size_t room = strlen(folder) + sizeof "/terrain.bin";
        char *path = malloc(room);
        if (!path) return free(b), NULL;
        snprintf(path, room, "%s/terrain.bin", folder);
        problem = terrain_read(&b->terrain, path);
        if (problem) {
            fail(b, "terrain: %s, got %.300s", problem, path);
            backend_free(b);
            b = NULL;
        }
        free(path);
    }
    return b;
}

int backend_initialize(Backend *b, Values *v, double start, double stop) {
    static const struct { int at; const char *name, *built; } texts[] = TEXTS;
    double state[NX];
    size_t i;
    (void)start, (void)stop;
    for (i = 0; i < sizeof texts / sizeof *texts; i++) {
        if (strcmp(v->strings[texts[i].at], texts[i].built))
            return fail(b, "%s: built into this FMU, got '%.100s', expected '%s'", texts[i].name,
                        v->strings[texts[i].at], texts[i].built);
    }
    memset(&b->now, 0, sizeof b->now);
    if (set_constants(b, v) != OK) return ERROR;
    hold_inputs(b, v);
    if (v->integers[AT_restart]) memcpy(state, v->reals + AT_measured_north, sizeof state);
    else if (starting_state(b, v, state) != OK) return ERROR;
    take_state(b, state);
    b->now.valid = 1;
    evaluate(applied, b->now.x, b->now.held, v->reals + AT_applied_thrust);
    read_out(b, v);
    return OK;
}

int backend_step(Backend *b, Values *v, double t, double h) {
    State *now = &b->now;
    double slope[2], z;
    (void)t;
    if (!(fabs(h - STEP) <= 1e-9))
        return fail(b, "helicopter: wrong step size, got %g s, expected %g s", h, STEP);
    if (v->integers[AT_restart]) {
        take_state(b, v->reals + AT_measured_north);
        now->valid = now->endless = 1;
    } else if (now->endless || v->integers[AT_outcome] == FLYING) {
        memcpy(now->common, v->reals + AT_state_north, sizeof now->common);
        memcpy(now->before, now->x, sizeof now->before);
    } else {
        return OK; /* after its end a flight stays put */
    }
    hold_inputs(b, v);
    z = elevation(b, now->x, slope);
    now->held[GROUND] = felt(z);
    evaluate(applied, now->x, now->held, v->reals + AT_applied_thrust);
    advance(rates, NX, now->x, now->held, now->substeps);
    now->flown = now->substeps;
    now->valid &= !isnan(z) && fabs(now->x[6]) < ATTITUDE_LIMIT &&
                  fabs(now->x[7]) < ATTITUDE_LIMIT && fabs(now->x[0]) < 1e9;
    read_out(b, v);
    return OK;
}

int backend_outputs(Backend *b, Values *v) { /* no input acts on an output at the same instant */
    (void)b, (void)v;
    return OK;
}

int backend_get_state(Backend *b, uint8_t **bytes, size_t *n) {
    *n = sizeof b->now;
    *bytes = malloc(*n);
    if (!*bytes) return fail(b, "state: no memory, got %lu bytes asked for", (unsigned long)*n);
    memcpy(*bytes, &b->now, *n);
    return OK;
}

int backend_set_state(Backend *b, const Values *v, const uint8_t *bytes, size_t n) {
    (void)v;
    if (n != sizeof b->now)
        return fail(b, "state: not of this FMU, got %lu bytes, expected %lu", (unsigned long)n,
                    (unsigned long)sizeof b->now);
    memcpy(&b->now, bytes, n);
    return OK;
}

/* The derivative of the last step: outputs at its end by the inputs that acted in it, `measured`
 * standing for the state at its beginning, restart or not. After initialization the last step is the
 * empty one. */
int backend_directional(Backend *b, const Values *v, const int *unknown, size_t n_unknown,
                        const int *known, size_t n_known, const double *seed, double *sensitivity) {
    const State *now = &b->now;
    double common[2 * NX], k[2 * NK], x[2 * NX], r[2 * NR], d[N_REALS], slope[2], z;
    const double *dx = x + NX;
    size_t i;
    (void)v;
    memset(common, 0, sizeof common);
    memset(k, 0, sizeof k);
    memset(d, 0, sizeof d);
    memcpy(common, now->common, sizeof now->common);
    memcpy(k, now->held, sizeof now->held);
    for (i = 0; i < n_known; i++) {
        const int at = known[i];
        if (at >= AT_command_thrust && at < AT_command_thrust + 4) k[NK + at - AT_command_thrust] += seed[i];
        else if (at >= AT_wind_north && at <= AT_wind_down) k[NK + WIND + at - AT_wind_north] += seed[i];
        else if (at >= AT_bias_north && at <= AT_bias_down) k[NK + BIAS + at - AT_bias_north] += seed[i];
        else if (at >= AT_measured_north && at <= AT_measured_d)
            common[NX + at - AT_measured_north] += seed[i];
        else return fail(b, "directional derivative: known is no input, got %d", at);
    }
    evaluate(own_state_tangent, common, k, x);
    memcpy(x, now->before, sizeof now->before);
    evaluate(applied_tangent, x, k, r);
    memcpy(d + AT_applied_thrust, r + 4, 4 * sizeof(double));
    if (now->flown) {
        z = elevation(b, x, slope);
        if (!isnan(z)) k[NK + GROUND] = slope[0] * dx[0] + slope[1] * dx[1];
        advance(rates_tangent, 2 * NX, x, k, now->flown);
    }
    z = elevation(b, x, slope);
    if (isnan(z)) slope[0] = slope[1] = 0.0;
    k[GROUND] = felt(z);
    k[NK + GROUND] = slope[0] * dx[0] + slope[1] * dx[1];
    evaluate(readings_tangent, x, k, r);
    memcpy(d + AT_state_north, dx, NX * sizeof(double));
    d[AT_state_north + ROTOR] = r[NR];
    memcpy(d + AT_pose_north, dx, 3 * sizeof(double));
    memcpy(d + AT_pose_phi, dx + 6, 3 * sizeof(double));
    memcpy(d + AT_velocity_north, r + NR + 1, 3 * sizeof(double));
    memcpy(d + AT_actuator_thrust, r + NR + 4, 4 * sizeof(double));
    d[AT_clearance] = -dx[2] - slope[0] * dx[0] - slope[1] * dx[1];
    d[AT_load_factor] = r[NR + 8];
    for (i = 0; i < n_unknown; i++) {
        if (unknown[i] < S_REALS || unknown[i] >= N_REALS)
            return fail(b, "directional derivative: unknown is no output, got %d", unknown[i]);
        sensitivity[i] = d[unknown[i]];
    }
    return OK;
}

void backend_free(Backend *b) {
    if (b) free(b->terrain.coefficients);
    free(b);
}
