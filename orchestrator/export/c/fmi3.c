/* FMI 3.0 for co-simulation, in front of a back end. The checks are in instance.c. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"
#include "instance.h"

static void tell(Instance *instance, int status, const char *category, const char *message) {
    fmi3LogMessageCallback log = (fmi3LogMessageCallback)instance->callback;
    if (log) log(instance->environment, (fmi3Status)status, category, message);
}

const char *fmi3GetVersion(void) { return fmi3Version; }

/* -- making --------------------------------------------------------------------------------------- */

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early_return,
    const fmi3ValueReference intermediate[], size_t n_intermediate,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
    fmi3IntermediateUpdateCallback update) {
    (void)visible, (void)early_return, (void)intermediate, (void)update;
    Instance prototype = {.tell = tell, .callback = (void (*)(void))log, .logging = logging,
                          .environment = environment, .name = (char *)name};
    if (event_mode || n_intermediate) {
        complain(&prototype, ERROR, "fmi3InstantiateCoSimulation: event mode and intermediate "
                                    "variables are not supported");
        return NULL;
    }
    char *folder = NULL;
    if (resources) {
        size_t n = strlen(resources);
        while (n > 1 && resources[n - 1] == '/') n--;
        folder = calloc(n + 1, 1);
        if (!folder) return NULL;
        memcpy(folder, resources, n);
    }
    Instance *instance = instance_new(prototype, name, token, folder);
    free(folder);
    return instance;
}

static fmi3Instance other_type(fmi3String name, fmi3InstanceEnvironment environment,
                               fmi3LogMessageCallback log) {
    Instance prototype = {.tell = tell, .callback = (void (*)(void))log, .environment = environment,
                          .name = (char *)name};
    complain(&prototype, ERROR, "fmi3Instantiate: not supported, expected co-simulation");
    return NULL;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                          fmi3Boolean visible, fmi3Boolean logging,
                                          fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log) {
    (void)token, (void)resources, (void)visible, (void)logging;
    return other_type(name, environment, log);
}

fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
    fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
    fmi3UnlockPreemptionCallback unlock) {
    (void)token, (void)resources, (void)visible, (void)logging, (void)update, (void)lock;
    (void)unlock;
    return other_type(name, environment, log);
}

void fmi3FreeInstance(fmi3Instance c) { instance_free(c); }

fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n,
                               const fmi3String categories[]) {
    Instance *instance = c;
    if (!permitted(instance, "fmi3SetDebugLogging", LIVING)) return fmi3Error;
    if (n && !categories) return (fmi3Status)complain(instance, ERROR, "fmi3SetDebugLogging: null pointer");
    instance->logging = on;
    return fmi3OK;
}

/* -- life cycle ----------------------------------------------------------------------------------- */

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean tolerance_defined,
                                       fmi3Float64 tolerance, fmi3Float64 start,
                                       fmi3Boolean stop_defined, fmi3Float64 stop) {
    (void)tolerance_defined, (void)tolerance;
    return (fmi3Status)instance_enter(c, "fmi3EnterInitializationMode", start,
                                      stop_defined ? stop : NAN);
}

#define CALL(name, call)                                                                           \
    fmi3Status fmi3##name(fmi3Instance c) { return (fmi3Status)call(c, "fmi3" #name); }
CALL(ExitInitializationMode, instance_exit)
CALL(Terminate, instance_terminate)
CALL(Reset, instance_reset)

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 t, fmi3Float64 h, fmi3Boolean no_rollback,
                      fmi3Boolean *event_needed, fmi3Boolean *terminate, fmi3Boolean *early_return,
                      fmi3Float64 *last_time) {
    (void)no_rollback;
    Instance *instance = c;
    int status = instance_step(instance, "fmi3DoStep", t, h);
    if (event_needed) *event_needed = fmi3False;
    if (terminate) *terminate = fmi3False;
    if (early_return) *early_return = fmi3False;
    if (last_time && instance) *last_time = instance->time;
    return (fmi3Status)status;
}

/* -- values --------------------------------------------------------------------------------------- */

#define ACCESS(name, kind, buffer, type, get, set, check)                                          \
    static int get_##name(Instance *instance, const uint32_t *references, size_t n,               \
                          fmi3##name *values, size_t n_values) {                                  \
        GET("fmi3Get" #name, kind, buffer, fmi3##name, get, check)                                \
    }                                                                                              \
    static int set_##name(Instance *instance, const uint32_t *references, size_t n,               \
                          const fmi3##name *values, size_t n_values) {                            \
        SET("fmi3Set" #name, kind, buffer, type, set)                                             \
    }                                                                                              \
    fmi3Status fmi3Get##name(fmi3Instance c, const fmi3ValueReference vr[], size_t n,             \
                             fmi3##name values[], size_t n_values) {                              \
        return (fmi3Status)get_##name(c, vr, n, values, n_values);                                \
    }                                                                                              \
    fmi3Status fmi3Set##name(fmi3Instance c, const fmi3ValueReference vr[], size_t n,             \
                             const fmi3##name values[], size_t n_values) {                        \
        return (fmi3Status)set_##name(c, vr, n, values, n_values);                                \
    }
ACCESS(Float64, FLOAT64, reals, double, , , 0)
ACCESS(Float32, FLOAT32, reals, double, , , 0)
ACCESS(Int8, INT8, integers, int64_t, , , 1)
ACCESS(UInt8, UINT8, integers, int64_t, , , 1)
ACCESS(Int16, INT16, integers, int64_t, , , 1)
ACCESS(UInt16, UINT16, integers, int64_t, , , 1)
ACCESS(Int32, INT32, integers, int64_t, , , 1)
ACCESS(UInt32, UINT32, integers, int64_t, , , 1)
ACCESS(Int64, INT64, integers, int64_t, , , 1)
ACCESS(UInt64, UINT64, integers, int64_t, , , 1)
ACCESS(Boolean, BOOLEAN, integers, int64_t, !!, !!, 0)

fmi3Status fmi3GetString(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                         fmi3String values[], size_t n_values) {
    return (fmi3Status)get_strings(c, "fmi3GetString", vr, n, values, n_values);
}

fmi3Status fmi3SetString(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                         const fmi3String values[], size_t n_values) {
    return (fmi3Status)set_strings(c, "fmi3SetString", vr, n, values, n_values);
}

/* -- state and derivatives ------------------------------------------------------------------------ */

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state) {
    return (fmi3Status)save(c, "fmi3GetFMUState", state);
}

fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state) {
    return (fmi3Status)restore(c, "fmi3SetFMUState", state);
}

fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state) {
    if (!permitted(c, "fmi3FreeFMUState", LIVING)) return fmi3Error;
    if (state) {
        free(*state);
        *state = NULL;
    }
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size) {
    return (fmi3Status)serialized_size(c, "fmi3SerializedFMUStateSize", state, size);
}

fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[],
                                 size_t size) {
    return (fmi3Status)serialize(c, "fmi3SerializeFMUState", state, bytes, size);
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size,
                                   fmi3FMUState *state) {
    return (fmi3Status)deserialize(c, "fmi3DeserializeFMUState", bytes, size, state);
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance c, const fmi3ValueReference unknowns[],
                                        size_t n_unknowns, const fmi3ValueReference knowns[],
                                        size_t n_knowns, const fmi3Float64 seed[], size_t n_seed,
                                        fmi3Float64 sensitivity[], size_t n_sensitivity) {
    return (fmi3Status)directional(c, "fmi3GetDirectionalDerivative", unknowns, n_unknowns, knowns,
                                   n_knowns, seed, n_seed, sensitivity, n_sensitivity);
}

/* -- what this FMU does not have ------------------------------------------------------------------ */

#define REFUSE(name, why, ...)                                                                     \
    fmi3Status fmi3##name(fmi3Instance c, __VA_ARGS__) {                                           \
        if (!permitted(c, "fmi3" #name, LIVING)) return fmi3Error;                                \
        return (fmi3Status)complain(c, ERROR, "fmi3" #name ": " why);                             \
    }
#define REFUSE_MODE(name)                                                                          \
    fmi3Status fmi3##name(fmi3Instance c) {                                                        \
        if (!permitted(c, "fmi3" #name, LIVING)) return fmi3Error;                                \
        return (fmi3Status)complain(c, ERROR, "fmi3" #name ": there is no such mode");            \
    }
#define REFERENCES const fmi3ValueReference vr[], size_t n

#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif
REFUSE_MODE(EnterEventMode)
REFUSE_MODE(EnterStepMode)
REFUSE_MODE(EnterConfigurationMode)
REFUSE_MODE(ExitConfigurationMode)
REFUSE_MODE(EvaluateDiscreteStates)
REFUSE(UpdateDiscreteStates, "there is no event mode", fmi3Boolean *a, fmi3Boolean *b,
       fmi3Boolean *d, fmi3Boolean *e, fmi3Boolean *f, fmi3Float64 *t)
REFUSE(GetBinary, "there are no binary variables", REFERENCES, size_t sizes[], fmi3Binary values[],
       size_t n_values)
REFUSE(SetBinary, "there are no binary variables", REFERENCES, const size_t sizes[],
       const fmi3Binary values[], size_t n_values)
REFUSE(GetClock, "there are no clocks", REFERENCES, fmi3Clock values[])
REFUSE(SetClock, "there are no clocks", REFERENCES, const fmi3Clock values[])
REFUSE(GetIntervalDecimal, "there are no clocks", REFERENCES, fmi3Float64 intervals[],
       fmi3IntervalQualifier qualifiers[])
REFUSE(GetIntervalFraction, "there are no clocks", REFERENCES, fmi3UInt64 counters[],
       fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[])
REFUSE(GetShiftDecimal, "there are no clocks", REFERENCES, fmi3Float64 shifts[])
REFUSE(GetShiftFraction, "there are no clocks", REFERENCES, fmi3UInt64 counters[],
       fmi3UInt64 resolutions[])
REFUSE(SetIntervalDecimal, "there are no clocks", REFERENCES, const fmi3Float64 intervals[])
REFUSE(SetIntervalFraction, "there are no clocks", REFERENCES, const fmi3UInt64 counters[],
       const fmi3UInt64 resolutions[])
REFUSE(SetShiftDecimal, "there are no clocks", REFERENCES, const fmi3Float64 shifts[])
REFUSE(SetShiftFraction, "there are no clocks", REFERENCES, const fmi3UInt64 counters[],
       const fmi3UInt64 resolutions[])
REFUSE(GetNumberOfVariableDependencies, "dependencies are constant: see modelDescription.xml",
       fmi3ValueReference vr, size_t *n)
REFUSE(GetVariableDependencies, "dependencies are constant: see modelDescription.xml",
       fmi3ValueReference vr, size_t a[], fmi3ValueReference b[], size_t d[],
       fmi3DependencyKind e[], size_t n)
REFUSE(GetAdjointDerivative, "not supported", const fmi3ValueReference unknowns[],
       size_t n_unknowns, const fmi3ValueReference knowns[], size_t n_knowns,
       const fmi3Float64 seed[], size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity)
REFUSE(GetOutputDerivatives, "outputs have no derivatives", REFERENCES, const fmi3Int32 orders[],
       fmi3Float64 values[], size_t n_values)

/* Of the other interface types; some masters look all names up. */
REFUSE_MODE(EnterContinuousTimeMode)
REFUSE(CompletedIntegratorStep, "not model exchange", fmi3Boolean no_rollback, fmi3Boolean *event,
       fmi3Boolean *terminate)
REFUSE(SetTime, "not model exchange", fmi3Float64 time)
REFUSE(SetContinuousStates, "not model exchange", const fmi3Float64 x[], size_t n)
REFUSE(GetContinuousStates, "not model exchange", fmi3Float64 x[], size_t n)
REFUSE(GetContinuousStateDerivatives, "not model exchange", fmi3Float64 x[], size_t n)
REFUSE(GetNominalsOfContinuousStates, "not model exchange", fmi3Float64 x[], size_t n)
REFUSE(GetEventIndicators, "not model exchange", fmi3Float64 z[], size_t n)
REFUSE(GetNumberOfEventIndicators, "not model exchange", size_t *n)
REFUSE(GetNumberOfContinuousStates, "not model exchange", size_t *n)
REFUSE(ActivateModelPartition, "not scheduled execution", fmi3ValueReference clock,
       fmi3Float64 time)
