/* What fmi2.c and fmi3.c share: one instance, its life cycle, its values and their checks. */
#ifndef HEDGEHOP_INSTANCE_H
#define HEDGEHOP_INSTANCE_H

#include "backend.h"

#ifdef __GNUC__
#pragma GCC visibility push(hidden)
#endif

enum { OK, WARNING, DISCARD, ERROR, FATAL };

/* Life cycle; one bit each, so that calls name the states they are permitted in. */
enum { INSTANTIATED = 1, INITIALIZING = 2, STEPPING = 4, TERMINATED = 8, FAILED = 16, DEAD = 32 };
enum { LIVING = INSTANTIATED | INITIALIZING | STEPPING | TERMINATED | FAILED };

enum { FLOAT64, FLOAT32, INT8, UINT8, INT16, UINT16, INT32, UINT32, INT64, UINT64, BOOLEAN, STRING };

/* One row of the generated table, which is sorted by `first`. A variable of FMI 3 has one value
 * reference; an array of FMI 2 has one per element, from `first` on. */
typedef struct {
    uint32_t first, span; /* value references */
    uint32_t at, size;    /* place in its buffer, in elements */
    uint8_t kind;
    uint8_t settable;     /* states in which the master may set it */
} Variable;

typedef struct Instance {
    int state;
    int status;               /* of the last step */
    int logging;              /* informative messages too */
    int initialized;          /* the back end has started with the values set so far */
    int outdated;             /* inputs were set that act on outputs at once */
    double start, stop, time; /* stop is NAN if the master gave none */
    Values values;
    Backend *backend;
    char *name;
    void (*tell)(struct Instance *, int status, const char *category, const char *message);
    void (*callback)(void);   /* the master's, which tell() knows how to call */
    void *environment;
} Instance;

typedef struct {
    size_t size;
    uint8_t bytes[];
} Saved;

/* NULL, and the reason told, if it cannot be made. The back end is made last. */
Instance *instance_new(Instance prototype, const char *name, const char *token,
                       const char *resource_folder);
void instance_free(Instance *);

int complain(Instance *, int status, const char *format, ...);
int permitted(Instance *, const char *call, int states); /* 0, told, if not */

/* A slice of a buffer that a value reference names. */
typedef struct {
    size_t at, count, variable;
} Slice;
int find_slice(Instance *, const char *call, uint32_t reference, Slice *);

/* OK if every reference is of `kind`, may be set now (if `set`), and all have `n_values` values. */
int check_access(Instance *, const char *call, const uint32_t *references, size_t n, int kind,
                 const void *values, size_t n_values, int set);
int refresh(Instance *, const char *call); /* computed values are up to date, or an error */
void mark(Instance *, const Slice *);      /* note that the master set it */

int instance_enter(Instance *, const char *call, double start, double stop);
int instance_exit(Instance *, const char *call);
int instance_step(Instance *, const char *call, double t, double h);
int instance_terminate(Instance *, const char *call);
int instance_reset(Instance *, const char *call);

int save(Instance *, const char *call, void **state);
int restore(Instance *, const char *call, const Saved *);
int serialized_size(Instance *, const char *call, const Saved *, size_t *size);
int serialize(Instance *, const char *call, const Saved *, void *bytes, size_t size);
int deserialize(Instance *, const char *call, const void *bytes, size_t size, void **state);

int directional(Instance *, const char *call, const uint32_t *unknowns, size_t n_unknowns,
                const uint32_t *knowns, size_t n_knowns, const double *seed, size_t n_seed,
                double *sensitivity, size_t n_sensitivity);

/* Bodies of the typed getters and setters. Nothing is written unless everything is right. */
#define GET(CALL, KIND, BUFFER, TYPE, CONVERT, CHECK)                                              \
    int status = check_access(instance, CALL, references, n, KIND, values, n_values, 0);          \
    if (status == OK) status = refresh(instance, CALL);                                           \
    if (status > WARNING) return status;                                                          \
    for (size_t i = 0, k = 0; i < n; i++) {                                                       \
        Slice slice;                                                                              \
        find_slice(instance, CALL, references[i], &slice);                                        \
        for (size_t j = 0; j < slice.count; j++, k++) {                                           \
            values[k] = (TYPE)CONVERT(instance->values.BUFFER[slice.at + j]);                     \
            if (CHECK && (int64_t)values[k] != (int64_t)instance->values.integers[slice.at + j])  \
                return complain(instance, ERROR, CALL ": value reference %u is out of the type's " \
                                "range", references[i]);                                          \
        }                                                                                         \
    }                                                                                             \
    return status;

#define SET(CALL, KIND, BUFFER, TYPE, CONVERT)                                                     \
    int status = check_access(instance, CALL, references, n, KIND, values, n_values, 1);          \
    if (status > WARNING) return status;                                                          \
    for (size_t i = 0, k = 0; i < n; i++) {                                                       \
        Slice slice;                                                                              \
        find_slice(instance, CALL, references[i], &slice);                                        \
        for (size_t j = 0; j < slice.count; j++, k++)                                             \
            instance->values.BUFFER[slice.at + j] = (TYPE)CONVERT(values[k]);                     \
        mark(instance, &slice);                                                                   \
    }                                                                                             \
    return status;

int get_strings(Instance *, const char *call, const uint32_t *references, size_t n,
                const char **values, size_t n_values);
int set_strings(Instance *, const char *call, const uint32_t *references, size_t n,
                const char *const *values, size_t n_values);

#ifdef __GNUC__
#pragma GCC visibility pop
#endif
#endif
