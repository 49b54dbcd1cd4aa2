/* FMI 2.0 for co-simulation, in front of a back end. The checks are in instance.c. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"
#include "instance.h"

static void tell(Instance *instance, int status, const char *category, const char *message) {
    fmi2CallbackLogger logger = (fmi2CallbackLogger)instance->callback;
    if (logger)
        logger(instance->environment, instance->name ? instance->name : "", (fmi2Status)status,
               category, "%s", message);
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

/* The resource folder of a file URI, to be freed; NULL if it is none. */
static char *folder_of(const char *uri) {
    if (!uri || strncmp(uri, "file:", 5) != 0) return NULL;
    const char *from = uri + 5;
    if (strncmp(from, "//", 2) == 0) { /* skip the authority */
        from = strchr(from + 2, '/');
        if (!from) return NULL;
    }
    char *folder = malloc(strlen(from) + 1), *to = folder;
    if (!folder) return NULL;
    while (*from) {
        char code[3] = {0};
        if (*from == '%') strncpy(code, from + 1, 2);
        char *end = code;
        long byte = strtol(code, &end, 16);
        int escaped = end == code + 2 && byte > 0;
        *to++ = escaped ? (char)byte : *from;
        from += escaped ? 3 : 1;
    }
    while (to > folder + 1 && to[-1] == '/') to--;
    *to = '\0';
    return folder;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String token, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible,
                              fmi2Boolean logging) {
    (void)visible;
    if (!callbacks) return NULL;
    Instance prototype = {.tell = tell, .callback = (void (*)(void))callbacks->logger, .logging = logging,
                          .environment = callbacks->componentEnvironment, .name = (char *)name};
    if (type != fmi2CoSimulation) {
        complain(&prototype, ERROR, "fmi2Instantiate: not supported, expected fmi2CoSimulation");
        return NULL;
    }
    char *folder = folder_of(resources);
    Instance *instance = instance_new(prototype, name, token, folder);
    free(folder);
    return instance;
}

void fmi2FreeInstance(fmi2Component c) { instance_free(c); }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n,
                               const fmi2String categories[]) {
    Instance *instance = c;
    if (!permitted(instance, "fmi2SetDebugLogging", LIVING)) return fmi2Error;
    if (n && !categories) return (fmi2Status)complain(instance, ERROR, "fmi2SetDebugLogging: null pointer");
    instance->logging = on;
    return fmi2OK;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance,
                               fmi2Real start, fmi2Boolean stop_defined, fmi2Real stop) {
    (void)tolerance_defined, (void)tolerance;
    Instance *instance = c;
    if (!permitted(instance, "fmi2SetupExperiment", INSTANTIATED)) return fmi2Error;
    instance->start = start;
    instance->stop = stop_defined ? stop : NAN;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    Instance *instance = c;
    if (!instance) return fmi2Error;
    return (fmi2Status)instance_enter(instance, "fmi2EnterInitializationMode", instance->start,
                                      instance->stop);
}

#define CALL(name, call)                                                                           \
    fmi2Status fmi2##name(fmi2Component c) { return (fmi2Status)call(c, "fmi2" #name); }
CALL(ExitInitializationMode, instance_exit)
CALL(Terminate, instance_terminate)
CALL(Reset, instance_reset)

#define ACCESS(name, kind, buffer, type, get, set, check)                                          \
    static int get_##name(Instance *instance, const uint32_t *references, size_t n,               \
                          fmi2##name *values, size_t n_values) {                                  \
        GET("fmi2Get" #name, kind, buffer, fmi2##name, get, check)                                \
    }                                                                                              \
    static int set_##name(Instance *instance, const uint32_t *references, size_t n,               \
                          const fmi2##name *values, size_t n_values) {                            \
        SET("fmi2Set" #name, kind, buffer, type, set)                                             \
    }                                                                                              \
    fmi2Status fmi2Get##name(fmi2Component c, const fmi2ValueReference vr[], size_t n,            \
                             fmi2##name values[]) {                                               \
        return (fmi2Status)get_##name(c, vr, n, values, n);                                       \
    }                                                                                              \
    fmi2Status fmi2Set##name(fmi2Component c, const fmi2ValueReference vr[], size_t n,            \
                             const fmi2##name values[]) {                                         \
        return (fmi2Status)set_##name(c, vr, n, values, n);                                       \
    }
ACCESS(Real, FLOAT64, reals, double, , , 0)
ACCESS(Integer, INT32, integers, int64_t, , , 1)
ACCESS(Boolean, BOOLEAN, integers, int64_t, !!, !!, 0)

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                         fmi2String values[]) {
    return (fmi2Status)get_strings(c, "fmi2GetString", vr, n, values, n);
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                         const fmi2String values[]) {
    return (fmi2Status)set_strings(c, "fmi2SetString", vr, n, values, n);
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    return (fmi2Status)save(c, "fmi2GetFMUstate", state);
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    return (fmi2Status)restore(c, "fmi2SetFMUstate", state);
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    if (!permitted(c, "fmi2FreeFMUstate", LIVING)) return fmi2Error;
    if (state) {
        free(*state);
        *state = NULL;
    }
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
    return (fmi2Status)serialized_size(c, "fmi2SerializedFMUstateSize", state, size);
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[],
                                 size_t size) {
    return (fmi2Status)serialize(c, "fmi2SerializeFMUstate", state, bytes, size);
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size,
                                   fmi2FMUstate *state) {
    return (fmi2Status)deserialize(c, "fmi2DeSerializeFMUstate", bytes, size, state);
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknowns[],
                                        size_t n_unknowns, const fmi2ValueReference knowns[],
                                        size_t n_knowns, const fmi2Real seed[],
                                        fmi2Real sensitivity[]) {
    return (fmi2Status)directional(c, "fmi2GetDirectionalDerivative", unknowns, n_unknowns, knowns,
                                   n_knowns, seed, n_knowns, sensitivity, n_unknowns);
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean no_rollback) {
    (void)no_rollback;
    return (fmi2Status)instance_step(c, "fmi2DoStep", t, h);
}

/* -- what is asked about a step, and what nobody can ask ------------------------------------------ */

#define REFUSED(call, states, what)                                                                \
    if (!permitted(c, call, states)) return fmi2Error;                                            \
    return (fmi2Status)complain(c, ERROR, call ": " what)

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value) {
    Instance *instance = c;
    if (!permitted(instance, "fmi2GetStatus", LIVING)) return fmi2Error;
    if (kind != fmi2DoStepStatus || !value) return fmi2Discard;
    *value = (fmi2Status)instance->status;
    return fmi2OK;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
    Instance *instance = c;
    if (!permitted(instance, "fmi2GetRealStatus", LIVING)) return fmi2Error;
    if (kind != fmi2LastSuccessfulTime || !value) return fmi2Discard;
    *value = instance->time;
    return fmi2OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
    if (!permitted(c, "fmi2GetBooleanStatus", LIVING)) return fmi2Error;
    if (kind != fmi2Terminated || !value) return fmi2Discard;
    *value = fmi2False;
    return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value) {
    (void)kind, (void)value;
    return permitted(c, "fmi2GetIntegerStatus", LIVING) ? fmi2Discard : fmi2Error;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value) {
    (void)kind, (void)value;
    return permitted(c, "fmi2GetStringStatus", LIVING) ? fmi2Discard : fmi2Error;
}

fmi2Status fmi2CancelStep(fmi2Component c) {
    REFUSED("fmi2CancelStep", LIVING, "steps are never pending");
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[]) {
    (void)vr, (void)n, (void)order, (void)value;
    REFUSED("fmi2SetRealInputDerivatives", LIVING, "inputs are held, not interpolated");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[]) {
    (void)vr, (void)n, (void)order, (void)value;
    REFUSED("fmi2GetRealOutputDerivatives", LIVING, "outputs have no derivatives");
}
