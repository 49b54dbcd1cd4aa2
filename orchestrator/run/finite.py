"""Find values that are not finite, quickly where all are."""

from collections.abc import Callable, Mapping
from math import isfinite
from typing import Any, cast

import numpy as np

from orchestrator.assembly.description import Port
from orchestrator.component import Value


def finiteness(ports: Mapping[str, Port]) -> Callable[[Mapping[str, Value]], bool]:
    """Return a quick test of all outputs of a component; it raises where outputs are missing.

    A sum of scalars is finite only if all of them are; it may overflow where all are, so that a
    False is to be looked into by :func:`nonfinite`.
    """
    outputs = {name: port for name, port in ports.items() if port.causality == "output"}
    if not any(port.shape or port.kind in ("string", "binary") for port in outputs.values()):
        count = len(outputs)
        if count == 1:
            (only,) = outputs
            return lambda values: isfinite(cast(float, values[only])) and len(values) == 1
        return lambda values: len(values) == count and isfinite(sum(cast(Any, values.values())))
    floats = [name for name, port in outputs.items() if port.kind == "float"]
    scalars = [name for name in floats if not ports[name].shape]
    arrays = [name for name in floats if ports[name].shape]

    found: dict[str, Any] = dict.fromkeys(arrays)  # arrays found finite; the same need no look

    def is_finite(values: Mapping[str, Value]) -> bool:
        if not isfinite(sum([cast(float, values[name]) for name in scalars])):
            return False
        for name in arrays:
            array = cast(Any, values[name])
            if array is not found[name]:
                if not np.isfinite(array).all():
                    return False
                found[name] = None if array.flags.writeable else array
        return True

    return is_finite


def nonfinite(ports: Mapping[str, Port], values: Mapping[str, Value]) -> str | None:
    """Return ``output 'name[index]' is not finite, got value`` of the first such, else None."""
    for name, port in ports.items():
        if port.causality != "output":
            continue
        value = np.asarray(values[name])
        if port.kind == "float":
            wrong = np.argwhere(~np.isfinite(value))
            if len(wrong):
                index = tuple(int(i) for i in wrong[0])
                element = f"[{', '.join(map(str, index))}]" if index else ""
                return f"output {name + element!r} is not finite, got {value[index]}"
    return None
