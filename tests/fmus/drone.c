/* The linear helicopter of tests/linear_model.py, under foreign names: one Euler step of 50 ms per
   step. Thrust above 30, 40 and 60: a Warning, a refusal, the end. */
#include "instance.h"

static const double T = 0.05, G = 9.80665, LAG = 0.8, FEEDBACK = 0.5;

Status model_step(Instance *m, double t, double h, double *reached) {
    (void)t; (void)h; (void)reached;
    Values *v = &m->v;
    if (v->lift > 60.0) return FATAL;
    if (v->lift > 40.0) return DISCARD;
    v->servo_thrust = v->lift;
    v->servo_pitch = v->nose - FEEDBACK * v->theta;
    v->servo_roll = v->bank - FEEDBACK * v->phi;
    v->servo_tail = v->course - FEEDBACK * v->psi;
    v->phi += (1 - LAG) * (v->bank - v->phi);
    v->theta += (1 - LAG) * (v->nose - v->theta);
    v->psi += (1 - LAG) * (v->course - v->psi);
    v->u += T * G * -v->theta;
    v->v += T * G * v->phi;
    v->w += T * G * (1.0 - v->lift);
    v->north += T * v->u;
    v->east += T * v->v;
    v->height -= T * v->w;
    return v->lift > 30.0 ? WARNING : OK;
}

void model_outputs(Instance *m) {
    m->v.v_n = m->v.u;
    m->v.v_e = m->v.v;
    m->v.v_d = m->v.w;
}
