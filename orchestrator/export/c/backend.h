/* What a front end (fmi2.c, fmi3.c) asks of a back end (process.c, or generated C).
 *
 * The front end owns the life cycle, the checks and the values; the back end owns the model. Both
 * include model.h, generated for each export, which has:
 *
 *   N_REALS, N_INTEGERS, N_STRINGS          lengths of the three buffers of Values
 *   S_REALS, S_INTEGERS, S_STRINGS          of these, how many come first and are set by the master
 *                                           (inputs, parameters, start values); the rest is computed
 *   AT_<name>                               where a variable starts in its buffer; characters of its
 *                                           name that C refuses are "_" (state.u: AT_state_u);
 *                                           arrays lie row by row, whatever the FMI version
 *   AT_TIME                                 where the front end keeps the present time, in reals
 *   HAVE_STATE, HAVE_DIRECTIONAL            0 or 1: whether the optional functions exist
 *   HAVE_FEEDTHROUGH                        0 or 1: whether inputs act on outputs at once, so that
 *                                           backend_outputs is called after they are set
 *
 * Status is FMI's: 0 OK, 1 Warning, 2 Discard, 3 Error, 4 Fatal. A back end tells the reason of
 * everything above OK by log() before it returns. Nothing here is called after a Fatal but
 * backend_free. Instances share nothing; one instance is used by one thread at a time.
 */
#ifndef HEDGEHOP_BACKEND_H
#define HEDGEHOP_BACKEND_H

#include <stddef.h>
#include <stdint.h>

#ifdef __GNUC__
#pragma GCC visibility push(hidden) /* several FMUs in one process must not see each other's */
#endif

typedef struct {
    double *reals;     /* Float64, Float32 */
    int64_t *integers; /* integers of all sizes, booleans (0, 1), enumerations */
    char **strings;    /* never NULL, from malloc; write them by replace_string() */
    unsigned char *changed; /* per variable of VARIABLES: set by the master since the last step */
} Values;

typedef void (*LogFunction)(void *environment, int status, const char *category,
                            const char *message);

typedef struct Backend Backend;

/* Make an instance, or log why not and return NULL. resource_folder: a path, not a URI, without a
 * slash at its end; NULL where the master gave none. */
Backend *backend_new(const char *instance_name, const char *resource_folder, LogFunction log,
                     void *environment);

/* Start from nothing at time `start` with the values set so far, and write all computed values.
 * May be called again before the first step (the master changed an input in initialization mode):
 * each call starts from nothing. stop is NAN if the master gave none. */
int backend_initialize(Backend *, Values *, double start, double stop);

/* Inputs at t -> computed values at t + h. On Discard nothing has advanced. */
int backend_step(Backend *, Values *, double t, double h);

/* Computed values again at the present instant, after inputs changed (direct feed-through). */
int backend_outputs(Backend *, Values *);

/* Everything hidden that decides the future, after initialization. The front end saves Values itself
 * and has put them back before it calls backend_set_state, on an instance that may be of another
 * process and may not have been initialized. The caller frees *bytes. */
int backend_get_state(Backend *, uint8_t **bytes, size_t *n);
int backend_set_state(Backend *, const Values *, const uint8_t *bytes, size_t n);

/* sensitivity[i] = sum_j d unknown_i / d known_j seed_j at the present instant. unknown and known
 * are positions in Values.reals, arrays one position per element. Only if HAVE_DIRECTIONAL. */
int backend_directional(Backend *, const Values *, const int *unknown, size_t n_unknown,
                        const int *known, size_t n_known, const double *seed,
                        double *sensitivity);

/* Let go of everything. NULL is allowed. */
void backend_free(Backend *);

/* Given by the front end: put a copy of `text` in the place of *slot. 0 if there is no memory. */
int replace_string(char **slot, const char *text);

#ifdef __GNUC__
#pragma GCC visibility pop
#endif
#endif
