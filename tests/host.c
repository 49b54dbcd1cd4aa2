/* A master that is not Python: host LIBRARY TOKEN RESOURCES_URI IN OUT. Takes the real input IN to
 * 0.5, does ten steps of 0.1 s in two instances, prints the real output OUT of both, frees them. */
#include <dlfcn.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

#include "fmi2FunctionTypes.h"

static void logger(fmi2ComponentEnvironment e, fmi2String name, fmi2Status status, fmi2String kind,
                   fmi2String format, ...) {
    va_list rest;
    (void)e, (void)kind;
    va_start(rest, format);
    fprintf(stderr, "%s %d ", name, (int)status);
    vfprintf(stderr, format, rest);
    va_end(rest);
}

#define LOAD(name) fmi2##name##TYPE *name = (fmi2##name##TYPE *)dlsym(library, "fmi2" #name)
#define DO(call) if ((call) > fmi2Warning) return 3

int main(int n, char **arguments) {
    void *library = n == 6 ? dlopen(arguments[1], RTLD_NOW) : NULL;
    if (!library) return 2;
    LOAD(Instantiate); LOAD(SetupExperiment); LOAD(EnterInitializationMode); LOAD(SetReal);
    LOAD(ExitInitializationMode); LOAD(DoStep); LOAD(GetReal); LOAD(FreeInstance);
    const fmi2CallbackFunctions callbacks = {logger, calloc, free, NULL, NULL};
    const fmi2ValueReference in = (unsigned)atoi(arguments[4]), out = (unsigned)atoi(arguments[5]);
    fmi2Component c[2];
    for (int i = 0; i < 2; i++) {
        const fmi2Real half = 0.5;
        c[i] = Instantiate(i ? "second" : "first", fmi2CoSimulation, arguments[2], arguments[3],
                           &callbacks, fmi2False, fmi2False);
        if (!c[i]) return 4;
        DO(SetReal(c[i], &in, 1, &half));
        DO(SetupExperiment(c[i], fmi2False, 0.0, 0.0, fmi2False, 0.0));
        DO(EnterInitializationMode(c[i]));
        DO(ExitInitializationMode(c[i]));
    }
    for (int k = 0; k < 10; k++)
        for (int i = 0; i < 2; i++) DO(DoStep(c[i], 0.1 * k, 0.1, fmi2True));
    for (int i = 0; i < 2; i++) {
        fmi2Real y;
        DO(GetReal(c[i], &out, 1, &y));
        printf("%.17g\n", y);
        FreeInstance(c[i]);
    }
    return dlclose(library);
}
