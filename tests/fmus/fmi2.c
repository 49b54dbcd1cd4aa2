/* FMI 2.0 co-simulation in front of a model. */
#include "fmi2Functions.h"
#include "instance.h"

#define ALIVE (NEW | INITIALIZING | STEPPING | ENDED)

static void say(Instance *m, Status status, const char *category, const char *message) {
    ((fmi2CallbackLogger)m->logger)(m->environment, m->name, status, category,
                                    "%s (at %g s)", message, m->v.time);
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String token, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible,
                              fmi2Boolean logging) {
    (void)resources; (void)visible; (void)logging;
    if (type != fmi2CoSimulation) return NULL;
    Instance *m = instance_new(name, token);
    if (m && functions && functions->logger) {
        m->logger = (void *)functions->logger;
        m->environment = functions->componentEnvironment;
        m->log = say;
    }
    return m;
}

void fmi2FreeInstance(fmi2Component c) {
    Instance *m = c;
    if (!m) return;
    instance_enter(m, "FreeInstance", ALIVE | FAILED);
    model_misbehave(m, "FreeInstance");
    if (m->trace) fclose(m->trace);
    free(m);
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[]) {
    (void)on; (void)n; (void)names;
    return instance_enter(c, "SetDebugLogging", ALIVE) ? fmi2OK : fmi2Error;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance,
                               fmi2Real start, fmi2Boolean has_stop, fmi2Real stop) {
    (void)has_tolerance; (void)tolerance; (void)has_stop; (void)stop;
    Instance *m = c;
    m->v.time = start;
    return instance_call(m, "SetupExperiment", NEW, NEW);
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    return instance_call(c, "EnterInitializationMode", NEW, INITIALIZING);
}
fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    return instance_call(c, "ExitInitializationMode", INITIALIZING, STEPPING);
}
fmi2Status fmi2Terminate(fmi2Component c) {
    return instance_call(c, "Terminate", STEPPING, ENDED);
}
fmi2Status fmi2Reset(fmi2Component c) {
    ((Instance *)c)->v = START;
    return instance_call(c, "Reset", ALIVE | FAILED, NEW);
}

#ifndef WITHOUT_STEP
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean no_return) {
    (void)no_return;
    if (!instance_enter(c, "DoStep", STEPPING)) return fmi2Error;
    return instance_step(c, t, h);
}
#endif
fmi2Status fmi2CancelStep(fmi2Component c) { return instance_fail(c, "no such step"); }

/* ---- values ---- */

#define ACCESS(NAME, TYPE, READ, WRITE)                                                            \
    fmi2Status fmi2Get##NAME(fmi2Component c, const fmi2ValueReference vr[], size_t n,             \
                             TYPE values[]) {                                                      \
        Instance *m = c;                                                                           \
        if (!instance_enter(m, "Get" #NAME, ALIVE)) return fmi2Error;                              \
        model_outputs(m);                                                                          \
        for (size_t i = 0; i < n; i++) {                                                           \
            const Variable *x;                                                                     \
            READ                                                                                   \
        }                                                                                          \
        return fmi2OK;                                                                             \
    }                                                                                              \
    fmi2Status fmi2Set##NAME(fmi2Component c, const fmi2ValueReference vr[], size_t n,             \
                             const TYPE values[]) {                                                \
        Instance *m = c;                                                                           \
        if (!instance_enter(m, "Set" #NAME, ALIVE & ~ENDED)) return fmi2Error;                     \
        for (size_t i = 0; i < n; i++) {                                                           \
            const Variable *x;                                                                     \
            WRITE                                                                                  \
        }                                                                                          \
        return fmi2OK;                                                                             \
    }
#define FIND(TYPE, IS_SET)                                                                         \
    if (!(x = instance_find(m, vr[i], TYPE, IS_SET))) return fmi2Error;                            \
    char *at = (char *)&m->v + x->offset;

ACCESS(Real, fmi2Real, FIND(FLOAT64, 0) values[i] = *(double *)at;,
       FIND(FLOAT64, 1) *(double *)at = values[i];)
/* an enumeration is an Integer too, and held like FMI 3's */
#define IS_ENUMERATION (vr[i] < sizeof VARIABLES / sizeof *VARIABLES && VARIABLES[vr[i]].type == INT64)
ACCESS(Integer, fmi2Integer,
       FIND(IS_ENUMERATION ? INT64 : INT32, 0)
       values[i] = x->type == INT64 ? (int)*(int64_t *)at : *(int32_t *)at;,
       FIND(IS_ENUMERATION ? INT64 : INT32, 1)
       if (x->type == INT64) *(int64_t *)at = values[i]; else *(int32_t *)at = values[i];)
ACCESS(Boolean, fmi2Boolean, FIND(BOOLEAN, 0) values[i] = *(bool *)at;,
       FIND(BOOLEAN, 1) *(bool *)at = values[i] != 0;)
ACCESS(String, fmi2String, FIND(STRING, 0) values[i] = at;,
       FIND(STRING, 1) if (strlen(values[i]) >= sizeof(Text)) return instance_fail(m, "too long");
       strcpy(at, values[i]);)

/* ---- state ---- */

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    if (!instance_enter(c, "GetFMUstate", ALIVE)) return fmi2Error;
    if (!*state) *state = malloc(sizeof(Values));
    *(Values *)*state = ((Instance *)c)->v;
    return fmi2OK;
}
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    if (!instance_enter(c, "SetFMUstate", ALIVE)) return fmi2Error;
    ((Instance *)c)->v = *(Values *)state;
    return fmi2OK;
}
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    if (!instance_enter(c, "FreeFMUstate", ALIVE | FAILED)) return fmi2Error;
    free(*state);
    *state = NULL;
    return fmi2OK;
}
fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
    (void)state;
    *size = sizeof(Values);
    return instance_enter(c, "SerializedFMUstateSize", ALIVE) ? fmi2OK : fmi2Error;
}
fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t n) {
    if (!instance_enter(c, "SerializeFMUstate", ALIVE)) return fmi2Error;
    if (n < sizeof(Values)) return instance_fail(c, "the buffer is too small");
    memcpy(bytes, state, sizeof(Values));
    return fmi2OK;
}
fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t n,
                                   fmi2FMUstate *state) {
    if (!instance_enter(c, "DeSerializeFMUstate", ALIVE)) return fmi2Error;
    if (n != sizeof(Values)) return instance_fail(c, "not a state of this model");
    if (!*state) *state = malloc(sizeof(Values));
    memcpy(*state, bytes, sizeof(Values));
    return fmi2OK;
}

/* ---- derivatives and status ---- */

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[],
                                        size_t n_unknown, const fmi2ValueReference known[],
                                        size_t n_known, const fmi2Real seed[],
                                        fmi2Real sensitivity[]) {
    if (!instance_enter(c, "GetDirectionalDerivative", INITIALIZING | STEPPING)) return fmi2Error;
    for (size_t i = 0; i < n_unknown; i++) {
        sensitivity[i] = 0;
        for (size_t j = 0; j < n_known; j++)
            sensitivity[i] += model_partial(c, unknown[i], known[j]) * seed[j];
    }
    return fmi2OK;
}
fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[]) {
    (void)vr; (void)n; (void)order; (void)value;
    return instance_fail(c, "no input derivatives");
}
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[]) {
    (void)vr; (void)n; (void)order; (void)value;
    return instance_fail(c, "no output derivatives");
}
fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value) {
    (void)c; (void)kind; (void)value;
    return fmi2Discard;
}
fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
    if (kind != fmi2LastSuccessfulTime) return fmi2Discard;
    *value = ((Instance *)c)->reached;
    return fmi2OK;
}
fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value) {
    (void)c; (void)kind; (void)value;
    return fmi2Discard;
}
fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
    if (kind != fmi2Terminated) return fmi2Discard;
    *value = ((Instance *)c)->wants_end;
    return fmi2OK;
}
fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value) {
    (void)c; (void)kind; (void)value;
    return fmi2Discard;
}
