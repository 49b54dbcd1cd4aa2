/* y counts events at PERIOD, 2 PERIOD, ...: seen to the importer where it asked for events. */
#include "instance.h"

static double next(const Instance *m) { return (m->v.count + 1) * PERIOD; }

Status model_step(Instance *m, double t, double h, double *reached) {
    m->v.calls++;
    if (next(m) > t + h + 1e-9) return OK;
    if (m->may_return_early && next(m) < t + h - 1e-9) *reached = next(m);
    m->wants_event = m->has_events;
    while (!m->has_events && next(m) <= *reached + 1e-9) m->v.count++;
    return OK;
}

bool model_event(Instance *m) {
    if (next(m) > m->v.time + 1e-9) return false;
    m->v.count++;
    return next(m) <= m->v.time + 1e-9;
}

void model_outputs(Instance *m) { m->v.y = m->v.count; }
