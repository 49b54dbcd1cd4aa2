/* Every output is the input of the same type, at once. */
#include "instance.h"

Status model_step(Instance *m, double t, double h, double *reached) {
    (void)m; (void)t; (void)h; (void)reached;
    return OK;
}

#define PASS(NAME) memcpy(&m->v.NAME##_out, &m->v.NAME##_in, sizeof m->v.NAME##_in);

void model_outputs(Instance *m) { PASSED }
