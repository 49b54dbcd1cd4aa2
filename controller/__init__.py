"""Control-basis-function model predictive control (CBF: control *basis* function)."""
