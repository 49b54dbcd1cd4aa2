#include "instance.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "model.h" /* the generated tables */

#define SOME(n) ((n) ? (n) : 1)
static const char *const CATEGORIES[] = {"logStatusOK", "logStatusWarning", "logStatusDiscard",
                                         "logStatusError", "logStatusFatal"};

/* -- messages ----------------------------------------------------------------------------------- */

int complain(Instance *instance, int status, const char *format, ...) {
    char message[1024];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    instance->tell(instance, status, CATEGORIES[status], message);
    return status;
}

static void forward(void *environment, int status, const char *category, const char *message) {
    Instance *instance = environment;
    if (status < OK || status > FATAL) status = OK;
    if (status > OK || instance->logging)
        instance->tell(instance, status, category ? category : CATEGORIES[status], message);
}

static const char *state_name(int state) {
    switch (state) {
    case INSTANTIATED: return "instantiated";
    case INITIALIZING: return "initialization mode";
    case STEPPING: return "step mode";
    case TERMINATED: return "terminated";
    case FAILED: return "error";
    default: return "fatal";
    }
}

int permitted(Instance *instance, const char *call, int states) {
    if (!instance) return 0;
    if (instance->state & states) return 1;
    complain(instance, ERROR, "%s: not permitted in state %s", call, state_name(instance->state));
    return 0;
}

/* What a failure of the back end does to the life cycle. */
static int settle(Instance *instance, int status) {
    if (status < OK || status > FATAL) status = FATAL;
    if (status == ERROR) instance->state = FAILED;
    if (status == FATAL) instance->state = DEAD;
    return status;
}

/* -- making and freeing ------------------------------------------------------------------------- */

int replace_string(char **slot, const char *text) {
    size_t n = strlen(text) + 1;
    char *copy = malloc(n);
    if (!copy) return 0;
    memcpy(copy, text, n);
    free(*slot);
    *slot = copy;
    return 1;
}

static int start_values(Instance *instance) {
    Values *values = &instance->values;
    memset(values->reals, 0, SOME(N_REALS) * sizeof(double));
    memset(values->integers, 0, SOME(N_INTEGERS) * sizeof(int64_t));
    memset(values->changed, 0, N_VARIABLES);
    size_t at = 0;
    for (size_t i = 0; i < sizeof REAL_STARTS / sizeof *REAL_STARTS; i++)
        for (size_t j = 0; j < REAL_STARTS[i].count; j++) values->reals[at++] = REAL_STARTS[i].value;
    at = 0;
    for (size_t i = 0; i < sizeof INTEGER_STARTS / sizeof *INTEGER_STARTS; i++)
        for (size_t j = 0; j < INTEGER_STARTS[i].count; j++)
            values->integers[at++] = INTEGER_STARTS[i].value;
    for (size_t i = 0; i < N_STRINGS; i++)
        if (!replace_string(&values->strings[i], i < S_STRINGS ? STRING_STARTS[i] : "")) return 0;
    instance->start = instance->time = 0.0;
    instance->stop = NAN;
    instance->initialized = instance->outdated = 0;
    instance->status = OK;
    instance->state = INSTANTIATED;
    return 1;
}

Instance *instance_new(Instance prototype, const char *name, const char *token,
                       const char *resource_folder) {
    if (!name || !*name) {
        complain(&prototype, ERROR, "instantiate: the instance has no name");
        return NULL;
    }
    if (!token || strcmp(token, TOKEN) != 0) {
        complain(&prototype, ERROR, "instantiate: wrong token, got '%s', expected '%s'",
                 token ? token : "", TOKEN);
        return NULL;
    }
    Instance *instance = malloc(sizeof *instance);
    if (!instance) return NULL;
    *instance = prototype;
    instance->name = NULL;
    instance->values = (Values){calloc(SOME(N_REALS), sizeof(double)),
                                calloc(SOME(N_INTEGERS), sizeof(int64_t)),
                                calloc(SOME(N_STRINGS), sizeof(char *)), calloc(N_VARIABLES, 1)};
    const Values *made = &instance->values;
    int enough = replace_string(&instance->name, name) && made->reals && made->integers &&
                 made->strings && made->changed && start_values(instance);
    instance->backend =
        enough ? backend_new(instance->name, resource_folder, forward, instance) : NULL;
    if (!instance->backend) {
        instance_free(instance);
        return NULL;
    }
    return instance;
}

void instance_free(Instance *instance) {
    if (!instance) return;
    backend_free(instance->backend);
    for (size_t i = 0; instance->values.strings && i < N_STRINGS; i++)
        free(instance->values.strings[i]);
    free(instance->values.reals);
    free(instance->values.integers);
    free(instance->values.strings);
    free(instance->values.changed);
    free(instance->name);
    free(instance);
}

/* -- access to values --------------------------------------------------------------------------- */

int find_slice(Instance *instance, const char *call, uint32_t reference, Slice *slice) {
    size_t low = 0, high = N_VARIABLES;
    while (low < high) { /* the last row that begins at or before the reference */
        size_t middle = (low + high) / 2;
        if (VARIABLES[middle].first <= reference) low = middle + 1;
        else high = middle;
    }
    if (low > 0) {
        const Variable *variable = &VARIABLES[low - 1];
        uint32_t element = reference - variable->first;
        if (element < variable->span) {
            size_t count = variable->size / variable->span;
            *slice = (Slice){variable->at + element * count, count, low - 1};
            return OK;
        }
    }
    return complain(instance, ERROR, "%s: unknown value reference %u", call, reference);
}

int check_access(Instance *instance, const char *call, const uint32_t *references, size_t n,
                 int kind, const void *values, size_t n_values, int set) {
    const int readable = INITIALIZING | STEPPING | TERMINATED | FAILED;
    const int states = set ? INSTANTIATED | INITIALIZING | STEPPING
                           : FMI_VERSION == 3 ? readable | INSTANTIATED : readable;
    if (!permitted(instance, call, states)) return ERROR;
    if ((n && !references) || (n_values && !values))
        return complain(instance, ERROR, "%s: null pointer", call);
    size_t count = 0;
    for (size_t i = 0; i < n; i++) {
        Slice slice;
        if (find_slice(instance, call, references[i], &slice) != OK) return ERROR;
        const Variable *variable = &VARIABLES[slice.variable];
        if (variable->kind != kind)
            return complain(instance, ERROR, "%s: value reference %u is of another type", call,
                            references[i]);
        if (set && !(variable->settable & instance->state))
            return complain(instance, ERROR, "%s: value reference %u cannot be set in state %s",
                            call, references[i], state_name(instance->state));
        count += slice.count;
    }
    if (count != n_values)
        return complain(instance, ERROR, "%s: wrong number of values, got %zu, expected %zu", call,
                        n_values, count);
    return OK;
}

void mark(Instance *instance, const Slice *slice) {
    instance->values.changed[slice->variable] = 1;
    if (instance->state == INITIALIZING) instance->initialized = 0;
    instance->outdated = 1;
}

static int initialize(Instance *instance) {
    instance->values.reals[AT_TIME] = instance->time = instance->start;
    int status = backend_initialize(instance->backend, &instance->values, instance->start,
                                    instance->stop);
    instance->initialized = status <= WARNING;
    instance->outdated = 0;
    return settle(instance, status);
}

int refresh(Instance *instance, const char *call) {
    (void)call;
    if (instance->state == INITIALIZING && !instance->initialized) return initialize(instance);
    if (!HAVE_FEEDTHROUGH || instance->state != STEPPING || !instance->outdated) return OK;
    int status = settle(instance, backend_outputs(instance->backend, &instance->values));
    if (status <= WARNING) instance->outdated = 0;
    return status;
}

int get_strings(Instance *instance, const char *call, const uint32_t *references, size_t n,
                const char **values, size_t n_values) {
    int status = check_access(instance, call, references, n, STRING, values, n_values, 0);
    if (status == OK) status = refresh(instance, call);
    if (status > WARNING) return status;
    for (size_t i = 0, k = 0; i < n; i++) {
        Slice slice;
        find_slice(instance, call, references[i], &slice);
        for (size_t j = 0; j < slice.count; j++)
            values[k++] = instance->values.strings[slice.at + j];
    }
    return status;
}

int set_strings(Instance *instance, const char *call, const uint32_t *references, size_t n,
                const char *const *values, size_t n_values) {
    int status = check_access(instance, call, references, n, STRING, values, n_values, 1);
    for (size_t k = 0; status == OK && k < n_values; k++)
        if (!values[k]) status = complain(instance, ERROR, "%s: null pointer as a string", call);
    if (status > WARNING) return status;
    for (size_t i = 0, k = 0; i < n; i++) {
        Slice slice;
        find_slice(instance, call, references[i], &slice);
        for (size_t j = 0; j < slice.count; j++)
            if (!replace_string(&instance->values.strings[slice.at + j], values[k++]))
                return complain(instance, ERROR, "%s: out of memory", call);
        mark(instance, &slice);
    }
    return status;
}

/* -- life cycle --------------------------------------------------------------------------------- */

int instance_enter(Instance *instance, const char *call, double start, double stop) {
    if (!permitted(instance, call, INSTANTIATED)) return ERROR;
    if (!isfinite(start) || stop < start)
        return complain(instance, ERROR, "%s: wrong times, got start %g s, stop %g s", call, start,
                        stop);
    instance->start = instance->time = start;
    instance->values.reals[AT_TIME] = start;
    instance->stop = stop;
    instance->initialized = 0;
    instance->state = INITIALIZING;
    return OK;
}

int instance_exit(Instance *instance, const char *call) {
    if (!permitted(instance, call, INITIALIZING)) return ERROR;
    int status = instance->initialized ? OK : initialize(instance);
    if (status <= WARNING) instance->state = STEPPING;
    return status;
}

int instance_step(Instance *instance, const char *call, double t, double h) {
    if (!permitted(instance, call, STEPPING)) return ERROR;
    /* masters add their steps up in floating point: allow for the rounding of many */
    const double tolerance = 1e-9 + 1e-9 * fabs(instance->time);
    if (!isfinite(t) || fabs(t - instance->time) > tolerance)
        return complain(instance, ERROR, "%s: wrong time, got %.17g s, expected %.17g s", call, t,
                        instance->time);
    if (!(isfinite(h) && h > 0.0))
        return complain(instance, ERROR, "%s: wrong step size, got %g s, expected above 0 s", call,
                        h);
    if (t + h > instance->stop + tolerance + 1e-9 * h)
        return complain(instance, ERROR, "%s: beyond the stop time, got %.17g s, expected %.17g s",
                        call, t + h, instance->stop);
    instance->status =
        settle(instance, backend_step(instance->backend, &instance->values, t, h));
    if (instance->status <= WARNING) {
        instance->values.reals[AT_TIME] = instance->time = t + h;
        memset(instance->values.changed, 0, N_VARIABLES);
        instance->outdated = 0;
    }
    return instance->status;
}

int instance_terminate(Instance *instance, const char *call) {
    if (!permitted(instance, call, STEPPING | FAILED)) return ERROR;
    if (instance->state == STEPPING) instance->state = TERMINATED;
    return OK;
}

int instance_reset(Instance *instance, const char *call) {
    if (!permitted(instance, call, LIVING)) return ERROR;
    return start_values(instance) ? OK : complain(instance, ERROR, "%s: out of memory", call);
}

/* -- state -------------------------------------------------------------------------------------- */

typedef struct {
    char magic[8];
    char token[40];
    int32_t state, status, initialized, outdated;
    double start, stop, time;
    uint64_t backend; /* bytes of the back end, at the end */
} Header;

static const char MAGIC[8] = "hedgehop";
enum { FLAT = N_REALS * sizeof(double) + N_INTEGERS * sizeof(int64_t) + N_VARIABLES };

int save(Instance *instance, const char *call, void **state) {
    if (!permitted(instance, call, LIVING & ~FAILED)) return ERROR;
    if (!HAVE_STATE) return complain(instance, ERROR, "%s: the component has no such call", call);
    if (!state) return complain(instance, ERROR, "%s: null pointer", call);
    Header header = {.state = instance->state, .status = instance->status,
                     .initialized = instance->initialized, .outdated = instance->outdated,
                     .start = instance->start, .stop = instance->stop, .time = instance->time};
    memcpy(header.magic, MAGIC, sizeof header.magic);
    strncpy(header.token, TOKEN, sizeof header.token - 1);
    uint8_t *hidden = NULL;
    size_t n_hidden = 0;
    if (instance->initialized) {
        int status = settle(instance, backend_get_state(instance->backend, &hidden, &n_hidden));
        if (status > WARNING) return status;
    }
    header.backend = n_hidden;
    size_t size = sizeof header + FLAT + n_hidden;
    for (size_t i = 0; i < N_STRINGS; i++) size += strlen(instance->values.strings[i]) + 1;
    Saved *saved = malloc(sizeof *saved + size);
    if (!saved) {
        free(hidden);
        return complain(instance, ERROR, "%s: out of memory", call);
    }
    saved->size = size;
    uint8_t *to = saved->bytes;
#define APPEND(from, n) (memcpy(to, (from), (n)), to += (n))
    APPEND(&header, sizeof header);
    APPEND(instance->values.reals, N_REALS * sizeof(double));
    APPEND(instance->values.integers, N_INTEGERS * sizeof(int64_t));
    APPEND(instance->values.changed, N_VARIABLES);
    for (size_t i = 0; i < N_STRINGS; i++)
        APPEND(instance->values.strings[i], strlen(instance->values.strings[i]) + 1);
    if (n_hidden) APPEND(hidden, n_hidden);
    free(hidden);
    free(*state);
    *state = saved;
    return OK;
}

/* Whether the bytes are a whole state of this FMU. */
static int is_state(const uint8_t *bytes, size_t size) {
    Header header;
    if (size < sizeof header + FLAT) return 0;
    memcpy(&header, bytes, sizeof header);
    const int one = header.state == INSTANTIATED || header.state == INITIALIZING ||
                    header.state == STEPPING || header.state == TERMINATED;
    if (memcmp(header.magic, MAGIC, sizeof header.magic) != 0 || !one ||
        strncmp(header.token, TOKEN, sizeof header.token - 1) != 0)
        return 0;
    size_t left = size - sizeof header - FLAT;
    const uint8_t *text = bytes + sizeof header + FLAT;
    for (size_t i = 0; i < N_STRINGS; i++) {
        const uint8_t *end = left ? memchr(text, 0, left) : NULL;
        if (!end) return 0;
        left -= (size_t)(end + 1 - text);
        text = end + 1;
    }
    return left == header.backend;
}

int restore(Instance *instance, const char *call, const Saved *saved) {
    if (!permitted(instance, call, LIVING)) return ERROR;
    if (!saved) return complain(instance, ERROR, "%s: null pointer", call);
    if (!is_state(saved->bytes, saved->size))
        return complain(instance, ERROR, "%s: not a state of this FMU", call);
    Header header;
    const uint8_t *from = saved->bytes;
#define TAKE(to, n) (memcpy((to), from, (n)), from += (n))
    TAKE(&header, sizeof header);
    TAKE(instance->values.reals, N_REALS * sizeof(double));
    TAKE(instance->values.integers, N_INTEGERS * sizeof(int64_t));
    TAKE(instance->values.changed, N_VARIABLES);
    for (size_t i = 0; i < N_STRINGS; i++) {
        if (!replace_string(&instance->values.strings[i], (const char *)from))
            return settle(instance, complain(instance, ERROR, "%s: out of memory", call));
        from += strlen((const char *)from) + 1;
    }
    instance->start = header.start;
    instance->stop = header.stop;
    instance->time = header.time;
    instance->status = header.status;
    instance->initialized = header.initialized;
    instance->outdated = header.outdated;
    instance->state = header.state;
    if (!header.initialized) return OK;
    return settle(instance, backend_set_state(instance->backend, &instance->values, from,
                                              (size_t)header.backend));
}

int serialized_size(Instance *instance, const char *call, const Saved *saved, size_t *size) {
    if (!permitted(instance, call, LIVING)) return ERROR;
    if (!saved || !size) return complain(instance, ERROR, "%s: null pointer", call);
    *size = saved->size;
    return OK;
}

int serialize(Instance *instance, const char *call, const Saved *saved, void *bytes, size_t size) {
    if (!permitted(instance, call, LIVING)) return ERROR;
    if (!saved || !bytes) return complain(instance, ERROR, "%s: null pointer", call);
    if (size != saved->size)
        return complain(instance, ERROR, "%s: wrong size, got %zu, expected %zu", call, size,
                        saved->size);
    memcpy(bytes, saved->bytes, size);
    return OK;
}

int deserialize(Instance *instance, const char *call, const void *bytes, size_t size,
                void **state) {
    if (!permitted(instance, call, LIVING)) return ERROR;
    if (!bytes || !state) return complain(instance, ERROR, "%s: null pointer", call);
    if (!is_state(bytes, size))
        return complain(instance, ERROR, "%s: not a state of this FMU", call);
    Saved *saved = malloc(sizeof *saved + size);
    if (!saved) return complain(instance, ERROR, "%s: out of memory", call);
    saved->size = size;
    memcpy(saved->bytes, bytes, size);
    free(*state);
    *state = saved;
    return OK;
}

/* -- derivatives -------------------------------------------------------------------------------- */

#if HAVE_DIRECTIONAL
/* Positions in the reals of all elements of some variables, or NULL and told. */
static int *positions(Instance *instance, const char *call, const uint32_t *references, size_t n,
                      size_t expected) {
    int *found = malloc(SOME(expected) * sizeof *found);
    size_t count = 0;
    for (size_t i = 0; found && i < n; i++) {
        Slice slice;
        int bad = find_slice(instance, call, references[i], &slice) != OK;
        if (!bad && VARIABLES[slice.variable].kind > FLOAT32) {
            complain(instance, ERROR, "%s: value reference %u is no number", call, references[i]);
            bad = 1;
        }
        if (bad) {
            free(found);
            return NULL;
        }
        for (size_t j = 0; j < slice.count; j++, count++)
            if (count < expected) found[count] = (int)(slice.at + j);
    }
    if (found && count != expected) {
        complain(instance, ERROR, "%s: wrong number of values, got %zu, expected %zu", call,
                 expected, count);
        free(found);
        return NULL;
    }
    return found;
}
#endif

int directional(Instance *instance, const char *call, const uint32_t *unknowns, size_t n_unknowns,
                const uint32_t *knowns, size_t n_knowns, const double *seed, size_t n_seed,
                double *sensitivity, size_t n_sensitivity) {
    if (!permitted(instance, call, INITIALIZING | STEPPING | TERMINATED | FAILED)) return ERROR;
#if HAVE_DIRECTIONAL
    if ((n_unknowns && !unknowns) || (n_knowns && !knowns) || (n_seed && !seed) ||
        (n_sensitivity && !sensitivity))
        return complain(instance, ERROR, "%s: null pointer", call);
    int status = refresh(instance, call);
    if (status > WARNING) return status;
    int *of = positions(instance, call, unknowns, n_unknowns, n_sensitivity);
    int *by = of ? positions(instance, call, knowns, n_knowns, n_seed) : NULL;
    status = by ? backend_directional(instance->backend, &instance->values, of, n_sensitivity, by,
                                      n_seed, seed, sensitivity)
                : ERROR;
    free(of);
    free(by);
    return status;
#else
    (void)unknowns, (void)n_unknowns, (void)knowns, (void)n_knowns, (void)seed, (void)n_seed;
    (void)sensitivity, (void)n_sensitivity;
    return complain(instance, ERROR, "%s: the component has no such call", call);
#endif
}
