"""Kernels of both packages: what they compute depends on the sources alone."""

import importlib
import pkgutil
from types import ModuleType

import numba
import pytest
from numba.core.compiler import Flags
from numba.core.dispatcher import Dispatcher
from numba.core.targetconfig import ConfigStack

import controller
import plant
from controller import jit


def kernels(package: ModuleType):
    """Return every compiled function of a package by name, injected copies included."""
    found = {}
    for info in pkgutil.iter_modules(package.__path__, f"{package.__name__}."):
        module = importlib.import_module(info.name)
        spaces = [vars(module), *(v for v in vars(module).values() if isinstance(v, dict))]
        for space in spaces:
            for name, value in space.items():
                if isinstance(value, Dispatcher):
                    found[f"{info.name}.{name}"] = value
    return found


def flags_within(kernel, caller):
    """Return how numba compiles a kernel that it first meets in a caller with these flags."""
    flags = Flags()
    with ConfigStack().enter(caller):
        kernel.targetdescr.options.parse_as_flags(flags, kernel.targetoptions)
    return flags


@pytest.mark.parametrize("package", [plant, controller])
def test_nothing_is_inherited(package):
    """Every compiled function has the same flags in whichever caller numba meets it first."""
    strict, relaxed = Flags(), Flags()
    strict.nrt = relaxed.nrt = True
    strict.error_model, relaxed.error_model = "python", "numpy"
    relaxed.fastmath = relaxed.forceinline = True
    found = kernels(package)
    assert len(found) > 10
    for name, kernel in found.items():
        assert flags_within(kernel, strict) == flags_within(kernel, relaxed), name


def test_a_relaxed_caller_does_not_relax(monkeypatch, tmp_path):
    """A kernel first met in a caller that fuses multiply-adds still rounds its product."""
    monkeypatch.setattr(jit, "_FOLDER", str(tmp_path))
    kernel = jit.kernel(lambda a, b, c: a * b + c)
    caller = numba.njit(fastmath=True)(lambda a, b, c: kernel(a, b, c))
    a, b = 1.0 + 2.0**-30, 1.0 - 2.0**-30
    assert caller(a, b, -1.0) == 0.0
    assert kernel(a, b, -1.0) == 0.0
