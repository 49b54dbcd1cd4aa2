"""Values that the adapter keeps: copied, compared, and as JSON for a saved state."""

from typing import Any

import numpy as np

from orchestrator.component import Value
from orchestrator.fmu.variables import Variable


def copied(value: Value) -> Value:
    """Return a value that does not change when the caller's array does."""
    return value.copy() if isinstance(value, np.ndarray) else value


def is_same(a: Value, b: Value | None) -> bool:
    """Return whether two values are equal; None equals nothing."""
    return b is not None and (np.array_equal(a, b) if isinstance(a, np.ndarray) else bool(a == b))


def to_json(value: Value) -> Any:
    """Return a value as JSON holds it."""
    if isinstance(value, np.ndarray):
        return [to_json(one) for one in value.ravel().tolist()]
    return value.hex() if isinstance(value, bytes) else value


def from_json(variable: Variable, plain: Any) -> Value:
    """Return the value of a variable from JSON."""
    if not variable.shape:
        return bytes.fromhex(plain) if variable.kind == "binary" else plain
    if variable.kind != "binary":
        return np.array(plain).reshape(variable.shape)
    array = np.empty(len(plain), object)
    array[:] = [bytes.fromhex(one) for one in plain]
    return array.reshape(variable.shape)
