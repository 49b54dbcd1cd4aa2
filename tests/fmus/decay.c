/* x' = k x + u by explicit Euler with an internal step of STEP s, shorter at the end of a step. */
#include "instance.h"

Status model_step(Instance *m, double t, double h, double *reached) {
    (void)t; (void)reached;
    long n = (long)ceil(h / STEP - 1e-9);
    for (long i = 0; i < n; i++) {
        double part = i < n - 1 ? STEP : h - (double)(n - 1) * STEP;
        m->v.x += part * (m->v.k * m->v.x + m->v.u);
    }
    return OK;
}

void model_outputs(Instance *m) {
    m->v.der_x_ = m->v.k * m->v.x + m->v.u;
    m->v.y = m->v.x;
}

double model_partial(const Instance *m, uint32_t unknown, uint32_t known) {
    if (unknown == VR_y) return known == VR_x;
    if (unknown != VR_der_x_) return 0;
    return known == VR_x ? m->v.k : known == VR_u ? 1 : known == VR_k ? m->v.x : 0;
}
