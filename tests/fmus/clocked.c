/* At every tick of an input clock: y = u, and count goes up. Between ticks nothing changes. */
#include "instance.h"

Status model_step(Instance *m, double t, double h, double *reached) {
    (void)m; (void)t; (void)h; (void)reached;
    return OK;
}

bool model_event(Instance *m) {
    if (m->v.tick) {
        m->v.tick = false;
        m->v.y = m->v.u;
        m->v.count++;
    }
    return false;
}

void model_outputs(Instance *m) { (void)m; }
