"""Find values beyond their declared min and max, at next to no cost where there are none."""

from collections.abc import Callable, Mapping, Sequence
from math import inf
from typing import Any, cast

import numpy as np

from orchestrator.assembly.description import Port
from orchestrator.component import Value


def outsiders(
    ports: Mapping[str, Port],
) -> Callable[[Mapping[str, Value]], Sequence[str]] | None:
    """Return a function that names the outputs beyond their bounds; None where none has any."""
    bounds = {
        name: (-inf if port.min is None else port.min, inf if port.max is None else port.max)
        for name, port in ports.items()
        if port.causality == "output"
        and port.kind in ("float", "integer")
        and not (port.min is None and port.max is None)
    }
    if not bounds:
        return None
    scalars = [(name, *bound) for name, bound in bounds.items() if not ports[name].shape]
    arrays = [(name, *bound) for name, bound in bounds.items() if ports[name].shape]
    within: dict[str, Any] = {}  # read-only arrays found within; the same need no look

    def outside(values: Mapping[str, Value]) -> Sequence[str]:
        found: Sequence[str] = ()
        for name, low, high in scalars:
            if not low <= cast(float, values[name]) <= high:
                found = (*found, name)
        for name, low, high in arrays:
            array = cast(Any, values[name])
            if array is within.get(name):
                continue
            if array.size and not (array.min() >= low and array.max() <= high):
                found = (*found, name)
            elif not array.flags.writeable:
                within[name] = array
        return found

    return outside


def excess(port: Port, value: Value) -> str:
    """Return ``output 'name[index]' is out of range, got value, expected bounds`` of the first."""
    low = -inf if port.min is None else port.min
    high = inf if port.max is None else port.max
    array = np.asarray(value)
    index = tuple(int(i) for i in np.argwhere(~((array >= low) & (array <= high)))[0])
    element = f"[{', '.join(map(str, index))}]" if index else ""
    unit = port.unit_suffix
    expected = " and ".join(
        f"{word} {bound:g}{unit}"
        for word, bound in (("at least", port.min), ("at most", port.max))
        if bound is not None
    )
    got = f"{array[index]}{unit}"
    return (
        f"{port.causality} {port.name + element!r} is out of range, got {got}, expected {expected}"
    )
