"""Directional derivatives of an FMU: FMI 3 wants to know how many numbers there are, FMI 2 not."""

import ctypes
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from orchestrator.fmu.calls import Calls
from orchestrator.fmu.instance import pointer

FUNCTIONS = {2: "fmi2GetDirectionalDerivative", 3: "fmi3GetDirectionalDerivative"}


def directional(
    calls: Calls,
    version: int,
    unknowns: Sequence[int],
    knowns: Sequence[int],
    seed: NDArray[np.float64],
    count: int,
) -> NDArray[np.float64]:
    """Return the change (count,) of the unknowns where the knowns change by ``seed``."""
    found = np.zeros(count)
    given = np.ascontiguousarray(seed, np.float64)
    here, there = (ctypes.c_void_p(array.ctypes.data) for array in (given, found))
    arguments = _arguments(version, unknowns, knowns, here, there, given.size, count)
    calls(FUNCTIONS[version], *arguments)
    return found


def partials(
    calls: Calls,
    version: int,
    unknowns: Sequence[int],
    knowns: Sequence[int],
    rows: NDArray[np.float64],
) -> list[Callable[[], int]]:
    """Return calls made fast, one per known: each writes a row of derivatives by it."""
    one = ctypes.byref(ctypes.c_double(1.0))
    return [
        calls.bound(
            FUNCTIONS[version],
            *_arguments(version, unknowns, [known], one, _address(row), 1, len(unknowns)),
        )
        for known, row in zip(knowns, rows, strict=True)
    ]


def _address(row: Any) -> Any:
    return ctypes.byref(ctypes.c_double.from_buffer(row))


def _arguments(
    version: int,
    unknowns: Sequence[int],
    knowns: Sequence[int],
    seed: Any,
    found: Any,
    seeds: int,
    count: int,
) -> tuple[Any, ...]:
    of = [
        part
        for references in (unknowns, knowns)
        for part in (pointer(references, ctypes.c_uint), ctypes.c_size_t(len(references)))
    ]
    if version == 2:
        return *of, seed, found
    return *of, seed, ctypes.c_size_t(seeds), found, ctypes.c_size_t(count)
