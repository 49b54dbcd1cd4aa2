"""Find values that are not finite, quickly where all are."""

from collections.abc import Callable, Mapping
from math import isfinite
from operator import itemgetter
from typing import Any, cast

import numpy as np

from orchestrator.component import Value
from orchestrator.description import Port


def finiteness(ports: Mapping[str, Port]) -> Callable[[Mapping[str, Value]], bool]:
    """Return a quick test of all outputs of a component.

    A sum of scalars is finite only if all of them are; it may overflow where all are, so that a
    False is to be looked into by :func:`nonfinite`.
    """
    floats = [n for n, p in ports.items() if p.causality == "output" and p.kind == "float"]
    scalars = [n for n in floats if not ports[n].shape]
    arrays = [n for n in floats if ports[n].shape]
    pick = itemgetter(*scalars, *scalars[:1]) if scalars else None  # two or more give a tuple

    def is_finite(values: Mapping[str, Value]) -> bool:
        if pick is not None and not isfinite(sum(pick(values))):
            return False
        return not arrays or all(np.isfinite(cast(Any, values[name])).all() for name in arrays)

    return is_finite


def nonfinite(ports: Mapping[str, Port], values: Mapping[str, Value]) -> str | None:
    """Return ``output 'name[index]' is not finite, got value`` of the first such, else None."""
    for name, value in values.items():
        if ports[name].kind == "float":
            wrong = np.argwhere(~np.isfinite(cast(Any, value)))
            if len(wrong):
                index = tuple(int(i) for i in wrong[0])
                element = f"[{', '.join(map(str, index))}]" if index else ""
                return f"output {name + element!r} is not finite, got {np.asarray(value)[index]}"
    return None
