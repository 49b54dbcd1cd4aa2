/* One instance of a small FMU: its values, its life cycle, and what a model must provide.

   build.py generates variables.h from the table in models.py: struct Values (everything that an FMU
   state holds), VARIABLES (by value reference), START and an enumeration of value references.
   Nothing here is static on purpose: all FMUs of this folder clash in every global symbol. */
#ifndef INSTANCE_H
#define INSTANCE_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { OK, WARNING, DISCARD, ERROR, FATAL };
typedef int Status;
typedef enum {
    FLOAT64, FLOAT32, INT8, UINT8, INT16, UINT16, INT32, UINT32, INT64, UINT64, BOOLEAN, STRING,
    BINARY, CLOCK
} Type;
typedef enum { AT_START, TUNABLE, NEVER } Settable; /* until initialized, always, not at all */
typedef struct { Type type; Settable settable; size_t offset, count; } Variable;
typedef char Text[256];
typedef struct { size_t size; uint8_t bytes[256]; } Bytes;

#include "variables.h"

enum Mode { NEW = 1, INITIALIZING = 2, STEPPING = 4, EVENTS = 8, ENDED = 16, FAILED = 32, DEAD = 64 };

typedef struct Instance Instance;
struct Instance {
    Values v;      /* the FMU state */
    int mode;
    double reached;                       /* where the last step ended */
    bool wants_event, wants_end;          /* what the model says in a step or at an event */
    bool has_events, may_return_early;    /* what the importer allows */
    char name[128];
    void *environment;
    void (*log)(Instance *, Status, const char *category, const char *message);
    void *logger;
    FILE *trace;   /* every call by name, if the environment variable FMU_TRACE names a file */
};

/* the model: all but model_step and model_outputs have a default that does nothing */
Status model_step(Instance *m, double t, double h, double *reached);
void model_outputs(Instance *m);
bool model_event(Instance *m); /* true: once more */
double model_partial(const Instance *m, uint32_t unknown, uint32_t known);
Status model_misbehave(Instance *m, const char *call);

Instance *instance_new(const char *name, const char *token);
bool instance_enter(Instance *m, const char *call, int modes);
Status instance_fail(Instance *m, const char *message);
Status instance_call(Instance *m, const char *call, int modes, int next);
Status instance_step(Instance *m, double t, double h);
const Variable *instance_find(Instance *m, uint32_t reference, Type type, bool is_set);

#endif
