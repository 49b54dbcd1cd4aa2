/* y = t, until FAULT happens: in the call WHERE ("DoStep"), at step AT of it (0, 1, ...), TIMES
   times (for ever if negative). If the environment variable FMU_ONCE names a file, the file is made
   when the fault happens, and while it is there nothing does: a process that follows is well. */
#include <signal.h>
#include <sys/time.h>
#include <unistd.h>

#include "instance.h"

enum {
    NONE, SEGFAULT, ABORT, EXIT, EXIT_LATER, HANG, SLEEP, WARN, REFUSE, REFUSE_LONG, REFUSE_HALF, FAIL, DIE,
    NOT_A_NUMBER, INFINITE, OUT_OF_RANGE, LOG, RETURN_EARLY, STAND_STILL, TERMINATED, EVENT_LOOP
};

int happened = 0; /* not in the FMU state: a step taken again does not fail again */

static bool is_due(void) {
    const char *once = getenv("FMU_ONCE");
    if ((TIMES >= 0 && happened >= TIMES) || (once && access(once, F_OK) == 0)) return false;
    if (once) fclose(fopen(once, "w"));
    happened++;
    return true;
}

static Status harm(Instance *m) {
    switch (FAULT) {
    case SEGFAULT: raise(SIGSEGV); break;
    case ABORT: abort();
    case EXIT: exit(3);
    case EXIT_LATER: /* after the answer, between two steps */
        setitimer(ITIMER_REAL, &(struct itimerval){{0, 0}, {0, 20000}}, NULL);
        break;
    case HANG: for (;;) pause();
    case SLEEP: usleep((useconds_t)(DURATION * 1e6)); break;
    case WARN: return WARNING;
    case REFUSE: return DISCARD;
    case FAIL: return m ? instance_fail(m, "the model failed") : ERROR;
    case DIE: return FATAL;
    default: break;
    }
    return OK;
}

Status model_misbehave(Instance *m, const char *call) {
    return strcmp(call, WHERE) == 0 && is_due() ? harm(m) : OK;
}

Status model_step(Instance *m, double t, double h, double *reached) {
    Status status = OK;
    m->v.spoiled = 0;
    if (FAULT == REFUSE_LONG) { /* whenever the step is longer than LIMIT */
        if (h > LIMIT) return DISCARD;
    } else if (strcmp(WHERE, "DoStep") == 0 && m->v.steps >= AT && is_due()) {
        status = harm(m);
        if (FAULT == NOT_A_NUMBER) m->v.spoiled = NAN;
        if (FAULT == INFINITE) m->v.spoiled = INFINITY;
        if (FAULT == OUT_OF_RANGE) m->v.spoiled = 1000;
        if (FAULT == LOG && m->log) {
            m->log(m, WARNING, "logStatusWarning", "ice on the wing");
            m->log(m, OK, "logAll", "100% sure");
        }
        if (FAULT == TERMINATED) {
            m->wants_end = true;
            if (IS_FMI2) status = DISCARD;
        }
        if (FAULT == STAND_STILL || FAULT == RETURN_EARLY || FAULT == REFUSE_HALF)
            *reached = FAULT == STAND_STILL ? t : t + h / 2;
        if (FAULT == REFUSE_HALF || (FAULT == STAND_STILL && IS_FMI2)) status = DISCARD;
        if (FAULT == EVENT_LOOP) m->wants_event = true;
        if (status >= DISCARD && *reached == t + h) return status;
    }
    m->v.x += *reached - t;
    m->v.steps++;
    return status;
}

bool model_event(Instance *m) {
    (void)m;
    return FAULT == EVENT_LOOP && happened;
}

void model_outputs(Instance *m) { m->v.y = m->v.x + m->v.spoiled; }
