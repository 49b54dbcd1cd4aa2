/* x' = u, which is exact for held inputs. */
#include "instance.h"

Status model_step(Instance *m, double t, double h, double *reached) {
    (void)t; (void)reached;
    m->v.x += h * m->v.u;
    return OK;
}

void model_outputs(Instance *m) {
    m->v.der_x_ = m->v.u;
    m->v.y = m->v.x;
}

double model_partial(const Instance *m, uint32_t unknown, uint32_t known) {
    (void)m;
    return (unknown == VR_y && known == VR_x) || (unknown == VR_der_x_ && known == VR_u);
}
