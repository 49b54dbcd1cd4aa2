"""Trajectories shared among processes, each with an instance of its own; the same to the last bit."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from orchestrator.fmu.prediction_parameters import FmuModelParameters
from orchestrator.fmu.trajectories import Floats, Flown, Origin, Trajectories
from orchestrator.isolation.process import Process

if TYPE_CHECKING:
    from orchestrator.fmu.prediction import FmuModel


class Crew:
    """So many processes beside this one as the parameters say less one; they end with this object.

    Raises
    ------
    ValueError
        If processes are not possible here.
    """

    def __init__(self, parameters: FmuModelParameters) -> None:
        self._others = [Process() for _ in range(parameters.processes - 1)]
        for one in self._others:
            one.request("call", _join, replace(parameters, processes=1))
        for one in self._others:
            one.answer()

    def fly(
        self, own: Trajectories, origin: Origin, commands: Floats, wind: Floats, bias: Floats
    ) -> Flown:
        """Return what ``own.fly`` would; it flies the first share."""
        if len(commands) <= len(self._others):
            return own.fly(origin, commands, wind, bias)
        mine, *theirs = np.array_split(commands, len(self._others) + 1)
        try:
            for one, share in zip(self._others, theirs, strict=True):
                one.request("call", _fly, origin, share, wind, bias)
            parts = [own.fly(origin, mine, wind, bias), *(one.answer() for one in self._others)]
        except BaseException:
            for one in self._others:  # with answers that nobody waits for
                one.close()
            raise
        values, valid = zip(*parts, strict=True)
        return Flown(np.concatenate(values, axis=2), np.concatenate(valid))


_models: "list[FmuModel]" = []  # the one of this process


def _join(parameters: FmuModelParameters) -> None:
    from orchestrator.fmu.prediction import FmuModel

    _models.append(FmuModel(parameters))


def _fly(origin: Origin, commands: Floats, wind: Floats, bias: Floats) -> Flown:
    return _models[0].trajectories.fly(origin, commands, wind, bias)
