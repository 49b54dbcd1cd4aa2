"""Exported FMUs of the tests, each made once, and how to call them through FMPy."""

from ctypes import CFUNCTYPE, c_char_p, c_int, c_void_p, cast
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE

from orchestrator.export.export import choose, export

_FOLDER = TemporaryDirectory(prefix="hedgehop-exported-")
VERSIONS = (2, 3)
EVERYTHING = "small_exports:Everything"


@cache
def exported(use, fmi, scenario=None):
    """Return the FMU of a component."""
    file = Path(_FOLDER.name) / f"{use.replace(':', '-')}-{fmi}.fmu"
    export(choose(use, scenario), file, fmi=fmi)
    return file


@cache
def unpacked(file):
    """Return an FMU's folder and description."""
    folder = Path(_FOLDER.name) / f"{file.stem}-unpacked"
    fmpy.extract(str(file), str(folder))
    description = fmpy.read_model_description(
        str(file), validate_variable_names=True, validate_model_structure=True
    )
    return folder, description


class Master:
    """One instance of an FMU under FMPy: values by the components' names, arrays whole."""

    def __init__(self, file, **options):
        self.folder, self.description = unpacked(file)
        self.fmi = int(self.description.fmiVersion[0])
        self.messages = []
        self.known = {v.name: v for v in self.description.modelVariables}
        if self.fmi == 3:
            self.fmu = fmpy.instantiate_fmu(
                str(self.folder), self.description, "CoSimulation", logger=self._hear, **options
            )
        else:
            self.fmu = self._instantiated_2(**options)
        self.free = self.fmu.freeInstance

    def _hear(self, _, status, __, message):
        self.messages.append((status, message.decode()))

    def _instantiated_2(self, **options):
        """Return an instance with a logger of its own; FMPy's proxy knows but one per process."""
        kind = CFUNCTYPE(None, c_void_p, c_char_p, c_int, c_char_p, c_char_p, c_char_p)

        def hear(environment, name, status, category, form, message):
            assert form == b"%s"
            self._hear(environment, status, category, message)

        self._logger = kind(hear)
        self._callbacks = fmi2CallbackFunctions()
        self._callbacks.logger = cast(self._logger, fmi2CallbackLoggerTYPE)
        fmu = FMU2Slave(
            guid=self.description.guid, unzipDirectory=str(self.folder), instanceName="fmu",
            modelIdentifier=self.description.coSimulation.modelIdentifier,
        )  # fmt: skip
        fmu.instantiate(callbacks=self._callbacks, loggingOn=options.get("debug_logging", False))
        return fmu

    def initialize(self, start=0.0, stop=None, **values):
        """Bring a fresh or reset instance to its first step; the values are set before."""
        self.set(values)
        if self.fmi == 2:
            self.fmu.setupExperiment(startTime=start, stopTime=stop)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=start, stopTime=stop)
        self.fmu.exitInitializationMode()

    def again(self, **values):
        """Reset the instance and initialize it."""
        self.fmu.reset()
        self.messages.clear()
        self.initialize(**values)
        return self

    def parts(self, name):
        """Return the variables that make up one of a component."""
        if name in self.known:
            return [self.known[name]]
        return [v for key, v in self.known.items() if key.startswith(f"{name}[")]

    def references(self, name):
        """Return the value references of a component's variable."""
        return [v.valueReference for v in self.parts(name)]

    def _call(self, verb, name):
        kind = self.parts(name)[0].type
        if kind == "Enumeration":
            kind = "Integer" if self.fmi == 2 else "Int64"
        return getattr(self.fmu, f"{verb}{kind}")

    def set(self, values):
        """Set variables by name."""
        for name, value in values.items():
            self._call("set", name)(self.references(name), np.ravel(value).tolist())

    def get(self, name):
        """Return a value: a scalar, or an array flat in a list."""
        size = {}
        if self.fmi == 3:
            size["nValues"] = int(np.prod(self.known[name].shape, dtype=int))
        values = list(self._call("get", name)(self.references(name), **size))
        is_array = self.fmi == 3 and self.known[name].shape
        return values if is_array or len(values) > 1 else values[0]

    def step(self, time, size):
        """Do a step."""
        self.fmu.doStep(time, size)
