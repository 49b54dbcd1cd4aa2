/* FMI 3.0 co-simulation and scheduled execution in front of a model. */
#include "fmi3Functions.h"
#include "instance.h"

#define ALIVE (NEW | INITIALIZING | STEPPING | EVENTS | ENDED)

static void say(Instance *m, Status status, const char *category, const char *message) {
    char text[300];
    snprintf(text, sizeof text, "%s (at %g s)", message, m->v.time);
    ((fmi3LogMessageCallback)m->logger)(m->environment, status, category, text);
}

const char *fmi3GetVersion(void) { return fmi3Version; }

static Instance *made(fmi3String name, fmi3String token, fmi3InstanceEnvironment environment,
                      fmi3LogMessageCallback log) {
    Instance *m = instance_new(name, token);
    if (m && log) {
        m->logger = (void *)log;
        m->environment = environment;
        m->log = say;
    }
    return m;
}

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference required[], size_t n_required,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
    fmi3IntermediateUpdateCallback update) {
    (void)resources; (void)visible; (void)logging; (void)required; (void)n_required; (void)update;
    Instance *m = made(name, token, environment, log);
    if (m) {
        m->has_events = events;
        m->may_return_early = early;
    }
    return m;
}
fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3ClockUpdateCallback update,
    fmi3LockPreemptionCallback lock, fmi3UnlockPreemptionCallback unlock) {
    (void)resources; (void)visible; (void)logging; (void)update; (void)lock; (void)unlock;
    return made(name, token, environment, log);
}
fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                          fmi3Boolean visible, fmi3Boolean logging,
                                          fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log) {
    (void)name; (void)token; (void)resources; (void)visible; (void)logging; (void)environment;
    (void)log;
    return NULL;
}

void fmi3FreeInstance(fmi3Instance c) {
    Instance *m = c;
    if (!m) return;
    instance_enter(m, "FreeInstance", ALIVE | FAILED);
    model_misbehave(m, "FreeInstance");
    if (m->trace) fclose(m->trace);
    free(m);
}

fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String names[]) {
    (void)on; (void)n; (void)names;
    return instance_enter(c, "SetDebugLogging", ALIVE) ? fmi3OK : fmi3Error;
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean has_tolerance,
                                       fmi3Float64 tolerance, fmi3Float64 start,
                                       fmi3Boolean has_stop, fmi3Float64 stop) {
    (void)has_tolerance; (void)tolerance; (void)has_stop; (void)stop;
    ((Instance *)c)->v.time = start;
    return instance_call(c, "EnterInitializationMode", NEW, INITIALIZING);
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance c) {
    return instance_call(c, "ExitInitializationMode", INITIALIZING,
                                     ((Instance *)c)->has_events ? EVENTS : STEPPING);
}
fmi3Status fmi3EnterEventMode(fmi3Instance c) {
    int permitted = ((Instance *)c)->has_events ? STEPPING : 0;
    return instance_call(c, "EnterEventMode", permitted, EVENTS);
}
fmi3Status fmi3EnterStepMode(fmi3Instance c) {
    return instance_call(c, "EnterStepMode", EVENTS, STEPPING);
}
fmi3Status fmi3Terminate(fmi3Instance c) {
    return instance_call(c, "Terminate", STEPPING | EVENTS, ENDED);
}
fmi3Status fmi3Reset(fmi3Instance c) {
    ((Instance *)c)->v = START;
    return instance_call(c, "Reset", ALIVE | FAILED, NEW);
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *again, fmi3Boolean *end,
                                    fmi3Boolean *nominals, fmi3Boolean *states,
                                    fmi3Boolean *has_next, fmi3Float64 *next) {
    Instance *m = c;
    if (!instance_enter(m, "UpdateDiscreteStates", EVENTS)) return fmi3Error;
    m->wants_end = false;
    *again = model_event(m);
    *end = m->wants_end;
    *nominals = *states = *has_next = false;
    *next = 0;
    return fmi3OK;
}

#ifndef WITHOUT_STEP
fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 t, fmi3Float64 h, fmi3Boolean no_return,
                      fmi3Boolean *event, fmi3Boolean *end, fmi3Boolean *early, fmi3Float64 *last) {
    (void)no_return;
    Instance *m = c;
    if (!instance_enter(m, "DoStep", STEPPING)) return fmi3Error;
    Status status = instance_step(m, t, h);
    *event = m->wants_event;
    *end = m->wants_end;
    *early = status <= WARNING && m->reached < t + h;
    *last = m->reached;
    return status;
}
#endif

fmi3Status fmi3ActivateModelPartition(fmi3Instance c, fmi3ValueReference clock, fmi3Float64 time) {
    Instance *m = c;
    if (!instance_enter(m, "ActivateModelPartition", STEPPING)) return fmi3Error;
    if (!instance_find(m, clock, CLOCK, true)) return fmi3Error;
    *((bool *)((char *)&m->v + VARIABLES[clock].offset)) = true;
    m->v.time = time;
    model_event(m);
    return fmi3OK;
}

/* ---- values ---- */

#define GET_SET(NAME, CTYPE, TYPE)                                                                 \
    fmi3Status fmi3Get##NAME(fmi3Instance c, const fmi3ValueReference vr[], size_t n,              \
                             CTYPE values[], size_t n_values) {                                    \
        Instance *m = c;                                                                           \
        size_t k = 0;                                                                              \
        if (!instance_enter(m, "Get" #NAME, ALIVE)) return fmi3Error;                              \
        model_outputs(m);                                                                          \
        for (size_t i = 0; i < n; i++) {                                                           \
            const Variable *x = instance_find(m, vr[i], TYPE, false);                              \
            if (!x) return fmi3Error;                                                              \
            if (k + x->count > n_values) return instance_fail(m, "too few values");    \
            memcpy(values + k, (char *)&m->v + x->offset, x->count * sizeof(CTYPE));               \
            k += x->count;                                                                         \
        }                                                                                          \
        return k == n_values ? fmi3OK : instance_fail(m, "too many values");           \
    }                                                                                              \
    fmi3Status fmi3Set##NAME(fmi3Instance c, const fmi3ValueReference vr[], size_t n,              \
                             const CTYPE values[], size_t n_values) {                              \
        Instance *m = c;                                                                           \
        size_t k = 0;                                                                              \
        if (!instance_enter(m, "Set" #NAME, ALIVE & ~ENDED)) return fmi3Error;                     \
        for (size_t i = 0; i < n; i++) {                                                           \
            const Variable *x = instance_find(m, vr[i], TYPE, true);                               \
            if (!x) return fmi3Error;                                                              \
            if (k + x->count > n_values) return instance_fail(m, "too few values");    \
            memcpy((char *)&m->v + x->offset, values + k, x->count * sizeof(CTYPE));               \
            k += x->count;                                                                         \
        }                                                                                          \
        return k == n_values ? fmi3OK : instance_fail(m, "too many values");           \
    }
GET_SET(Float64, fmi3Float64, FLOAT64)
GET_SET(Float32, fmi3Float32, FLOAT32)
GET_SET(Int8, fmi3Int8, INT8)
GET_SET(UInt8, fmi3UInt8, UINT8)
GET_SET(Int16, fmi3Int16, INT16)
GET_SET(UInt16, fmi3UInt16, UINT16)
GET_SET(Int32, fmi3Int32, INT32)
GET_SET(UInt32, fmi3UInt32, UINT32)
GET_SET(Int64, fmi3Int64, INT64)
GET_SET(UInt64, fmi3UInt64, UINT64)
GET_SET(Boolean, fmi3Boolean, BOOLEAN)

#define VARIABLE_SIZE(NAME, TYPE, IS_SET, PERMITTED, EACH)                                         \
    Instance *m = c;                                                                               \
    size_t k = 0;                                                                                  \
    if (!instance_enter(m, NAME, PERMITTED)) return fmi3Error;                                     \
    if (!IS_SET) model_outputs(m);                                                                 \
    for (size_t i = 0; i < n; i++) {                                                               \
        const Variable *x = instance_find(m, vr[i], TYPE, IS_SET);                                 \
        if (!x) return fmi3Error;                                                                  \
        if (k + x->count > n_values) return instance_fail(m, "too few values");        \
        for (size_t j = 0; j < x->count; j++, k++) { EACH }                                        \
    }                                                                                              \
    return k == n_values ? fmi3OK : instance_fail(m, "too many values");

fmi3Status fmi3GetString(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                         fmi3String values[], size_t n_values) {
    VARIABLE_SIZE("GetString", STRING, false, ALIVE,
                  values[k] = ((Text *)((char *)&m->v + x->offset))[j];)
}
fmi3Status fmi3SetString(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                         const fmi3String values[], size_t n_values) {
    VARIABLE_SIZE("SetString", STRING, true, ALIVE & ~ENDED,
                  if (strlen(values[k]) >= sizeof(Text)) return instance_fail(m, "too long");
                  strcpy(((Text *)((char *)&m->v + x->offset))[j], values[k]);)
}
fmi3Status fmi3GetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t n, size_t sizes[],
                         fmi3Binary values[], size_t n_values) {
    VARIABLE_SIZE("GetBinary", BINARY, false, ALIVE,
                  Bytes *one = (Bytes *)((char *)&m->v + x->offset) + j;
                  sizes[k] = one->size; values[k] = one->bytes;)
}
fmi3Status fmi3SetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                         const size_t sizes[], const fmi3Binary values[], size_t n_values) {
    VARIABLE_SIZE("SetBinary", BINARY, true, ALIVE & ~ENDED,
                  Bytes *one = (Bytes *)((char *)&m->v + x->offset) + j;
                  if (sizes[k] > sizeof one->bytes) return instance_fail(m, "too long");
                  one->size = sizes[k]; memcpy(one->bytes, values[k], sizes[k]);)
}
fmi3Status fmi3GetClock(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                        fmi3Clock values[]) {
    size_t n_values = n;
    VARIABLE_SIZE("GetClock", CLOCK, false, EVENTS,
                  values[k] = *((bool *)((char *)&m->v + x->offset));)
}
fmi3Status fmi3SetClock(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                        const fmi3Clock values[]) {
    size_t n_values = n;
    VARIABLE_SIZE("SetClock", CLOCK, true, EVENTS,
                  *((bool *)((char *)&m->v + x->offset)) = values[k];)
}
fmi3Status fmi3GetIntervalDecimal(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                                  fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[]) {
    Instance *m = c;
    if (!instance_enter(m, "GetIntervalDecimal", INITIALIZING | EVENTS | STEPPING)) return fmi3Error;
    for (size_t i = 0; i < n; i++) {
        if (!instance_find(m, vr[i], CLOCK, false)) return fmi3Error;
        intervals[i] = INTERVAL;
        qualifiers[i] = fmi3IntervalUnchanged;
    }
    return fmi3OK;
}

/* ---- state ---- */

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state) {
    if (!instance_enter(c, "GetFMUState", ALIVE)) return fmi3Error;
    if (!*state) *state = malloc(sizeof(Values));
    *(Values *)*state = ((Instance *)c)->v;
    return fmi3OK;
}
fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state) {
    if (!instance_enter(c, "SetFMUState", ALIVE)) return fmi3Error;
    ((Instance *)c)->v = *(Values *)state;
    return fmi3OK;
}
fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state) {
    if (!instance_enter(c, "FreeFMUState", ALIVE | FAILED)) return fmi3Error;
    free(*state);
    *state = NULL;
    return fmi3OK;
}
fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size) {
    (void)state;
    *size = sizeof(Values);
    return instance_enter(c, "SerializedFMUStateSize", ALIVE) ? fmi3OK : fmi3Error;
}
fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[], size_t n) {
    if (!instance_enter(c, "SerializeFMUState", ALIVE)) return fmi3Error;
    if (n < sizeof(Values)) return instance_fail(c, "the buffer is too small");
    memcpy(bytes, state, sizeof(Values));
    return fmi3OK;
}
fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t n,
                                   fmi3FMUState *state) {
    if (!instance_enter(c, "DeserializeFMUState", ALIVE)) return fmi3Error;
    if (n != sizeof(Values)) return instance_fail(c, "not a state of this model");
    if (!*state) *state = malloc(sizeof(Values));
    memcpy(*state, bytes, sizeof(Values));
    return fmi3OK;
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance c, const fmi3ValueReference unknown[],
                                        size_t n_unknown, const fmi3ValueReference known[],
                                        size_t n_known, const fmi3Float64 seed[], size_t n_seed,
                                        fmi3Float64 sensitivity[], size_t n_sensitivity) {
    int modes = INITIALIZING | STEPPING | EVENTS;
    if (!instance_enter(c, "GetDirectionalDerivative", modes)) return fmi3Error;
    if (n_seed != n_known || n_sensitivity != n_unknown)
        return instance_fail(c, "wrong number of seeds or sensitivities");
    for (size_t i = 0; i < n_unknown; i++) {
        sensitivity[i] = 0;
        for (size_t j = 0; j < n_known; j++)
            sensitivity[i] += model_partial(c, unknown[i], known[j]) * seed[j];
    }
    return fmi3OK;
}
