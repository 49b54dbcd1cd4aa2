/* Life cycle and look-up, shared by fmi2.c and fmi3.c: as strict as the standards allow. */
#include "instance.h"
#include <unistd.h>

__attribute__((weak)) bool model_event(Instance *m) { (void)m; return false; }
__attribute__((weak)) double model_partial(const Instance *m, uint32_t unknown, uint32_t known) {
    (void)m; (void)unknown; (void)known;
    return 0;
}
__attribute__((weak)) Status model_misbehave(Instance *m, const char *call) {
    (void)m; (void)call;
    return OK;
}

Instance *instance_new(const char *name, const char *token) {
    if (!token || strcmp(token, TOKEN) || model_misbehave(NULL, "Instantiate")) return NULL;
#ifdef ONCE /* not even after the first is gone; a copy of this library has its own static ones */
    char process[20];
    snprintf(process, sizeof process, "%d", (int)getpid());
    const char *before = getenv(TOKEN);
    if (before && !strcmp(before, process)) return NULL;
    setenv(TOKEN, process, 1);
#endif
    Instance *m = calloc(1, sizeof *m);
    m->v = START;
    m->mode = NEW;
    snprintf(m->name, sizeof m->name, "%s", name);
    const char *trace = getenv("FMU_TRACE");
    if (trace) m->trace = fopen(trace, "a");
    return m;
}

Status instance_fail(Instance *m, const char *message) {
    m->mode = FAILED;
    if (m->log) m->log(m, ERROR, "logStatusError", message);
    return ERROR;
}

bool instance_enter(Instance *m, const char *call, int modes) {
    if (m->trace) {
        fprintf(m->trace, "%s %s\n", m->name, call);
        fflush(m->trace);
    }
    if (m->mode & modes) return true;
    char text[200];
    snprintf(text, sizeof text, "%s is not permitted in mode %d", call, m->mode);
    instance_fail(m, text);
    return false;
}

Status instance_call(Instance *m, const char *call, int modes, int next) {
    if (!instance_enter(m, call, modes)) return ERROR;
    Status status = model_misbehave(m, call);
    m->mode = status == ERROR ? FAILED : status == FATAL ? DEAD : next;
    return status;
}

Status instance_step(Instance *m, double t, double h) {
    if (fabs(t - m->v.time) > 1e-9) {
        char text[200];
        snprintf(text, sizeof text, "step begins at %.17g, expected %.17g", t, m->v.time);
        return instance_fail(m, text);
    }
    m->wants_event = m->wants_end = false;
    m->reached = t + h;
    Status status = model_step(m, t, h, &m->reached);
    if (status <= WARNING || m->reached < t + h) m->v.time = m->reached;
    if (status == DISCARD && m->reached == t + h) m->reached = t;
    if (status >= ERROR) m->mode = status == ERROR ? FAILED : DEAD;
    return status;
}

const Variable *instance_find(Instance *m, uint32_t reference, Type type, bool is_set) {
    char text[200];
    if (reference >= sizeof VARIABLES / sizeof *VARIABLES || VARIABLES[reference].type != type) {
        snprintf(text, sizeof text, "no variable %u of type %d", reference, type);
        instance_fail(m, text);
        return NULL;
    }
    const Variable *x = &VARIABLES[reference];
    bool is_early = m->mode == NEW || m->mode == INITIALIZING;
    if (is_set && (x->settable == NEVER || (x->settable == AT_START && !is_early))) {
        snprintf(text, sizeof text, "variable %u cannot be set in mode %d", reference, m->mode);
        instance_fail(m, text);
        return NULL;
    }
    return x;
}
