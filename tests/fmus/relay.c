/* y(t + h) = SCALE u(t): passes its input on, one step late. */
#include "instance.h"

#ifndef SCALE
#define SCALE 1
#endif

double scale = SCALE; /* global, as in every relay: libraries must not share it */

double scaled(double u) { return scale * u; }

Status model_step(Instance *m, double t, double h, double *reached) {
    (void)t; (void)h; (void)reached;
    m->v.y = scaled(m->v.u);
    return OK;
}

void model_outputs(Instance *m) { (void)m; }
