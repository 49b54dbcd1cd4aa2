"""An FMU, unpacked and loaded: what instances are made from.

Components and prediction models alike start here; several instances share one folder and one
library.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING
from weakref import WeakValueDictionary

from orchestrator.component import Status
from orchestrator.fmu.archive import DESCRIPTION, unpack
from orchestrator.fmu.calls import Library
from orchestrator.fmu.description import Annotation, annotation, read
from orchestrator.fmu.errors import FmuError
from orchestrator.fmu.fmi2 import REQUIRED as REQUIRED2
from orchestrator.fmu.fmi2 import Fmi2
from orchestrator.fmu.fmi3 import CO_SIMULATION, EVENTS, SCHEDULED, Fmi3
from orchestrator.fmu.fmi3 import REQUIRED as REQUIRED3
from orchestrator.fmu.gather import gathered
from orchestrator.fmu.state import FMI2, FMI3
from orchestrator.fmu.variables import Variable, variables

if TYPE_CHECKING:
    from fmpy.model_description import CoSimulation, ModelDescription

# by token: instances of FMUs that allow one per process
_alive: "WeakValueDictionary[str, Fmi2 | Fmi3]" = WeakValueDictionary()


@dataclass(frozen=True)
class Described:
    """What is known of an FMU without running any of it.

    Attributes
    ----------
    description : ModelDescription
        With arrays gathered, where they are.
    variables : mapping
        By name, in the order of the description.
    annotation : Annotation or None
        Of our own exporter.
    """

    name: str
    folder: Path
    description: "ModelDescription"
    variables: Mapping[str, Variable]
    annotation: Annotation | None
    is_scheduled: bool
    owner: TemporaryDirectory[str] | None = field(default=None, repr=False)

    @property
    def is_fmi2(self) -> bool:
        """FMI 2.0 or 3.0."""
        return self.description.fmiVersion == "2.0"

    @property
    def interface(self) -> "CoSimulation":
        """Capabilities, of scheduled execution too."""
        assert self.description.coSimulation is not None  # read() has seen to that
        return self.description.coSimulation

    def close(self) -> None:
        """Remove what was unpacked; may be called twice."""
        if self.owner is not None:
            self.owner.cleanup()


def describe(
    file: Path,
    *,
    arrays: bool | None = None,
    scheduled: bool = False,
    validate: bool = True,
    only: Sequence[str] | None = None,
) -> Described:
    """Unpack an FMU and read its description; nothing of it is run.

    Parameters
    ----------
    arrays : bool, optional
        Whether scalars named ``u[1]`` become arrays; None as the FMU's annotation says.
    scheduled : bool
        Prefer scheduled execution where co-simulation is offered as well.
    only : sequence of str, optional
        What to unpack besides the description, where the FMU is not to be run.

    Raises
    ------
    ValueError
        In one line, with nothing left behind, if it is no FMU that can be simulated.
    """
    folder, owner = unpack(file, None if only is None else [DESCRIPTION, *only])
    try:
        description, is_scheduled = read(folder, file.name, validate=validate, scheduled=scheduled)
        own = annotation(folder)
        elements = {}
        if arrays if arrays is not None else own is not None and own.arrays:
            description, elements = gathered(description)
        return Described(
            file.name,
            folder,
            description,
            variables(description, elements),
            own,
            is_scheduled,
            owner,
        )
    except BaseException:
        if owner is not None:
            owner.cleanup()
        raise


class Fmu:
    """An FMU whose library is loaded.

    Raises
    ------
    ValueError
        In one line, if there is no binary for this platform, or it cannot be used.
    """

    def __init__(self, described: Described) -> None:
        self.described = described
        self.library = Library(_binary(described), described.name)
        missing = self.library.lacks(self._needed())
        if missing:
            raise ValueError(
                f"{described.name}: its binary lacks functions, got no {', '.join(missing)}"
            )
        self._drop_empty_promises()

    @property
    def has_events(self) -> bool:
        """Whether it offers event mode."""
        return self.described.interface.hasEventMode

    def instantiate(
        self, name: str, *, is_logging: bool = False, event_mode: bool = True
    ) -> Fmi2 | Fmi3:
        """Return a new instance, not initialized yet.

        Raises
        ------
        FmuError
            If the FMU refuses, as for a wrong GUID, or allows no more than one per process.
        """
        found, folder = self.described.description, self.described.folder
        token = str(found.guid)
        is_only = self.described.interface.canBeInstantiatedOnlyOncePerProcess
        other = _alive.get(token)
        if is_only and other is not None and other.calls.is_usable:
            raise FmuError(
                f"{self.described.name}: allows one instance per process and has one already, "
                "expected 'isolation: process'",
                Status.ERROR,
            )
        try:
            if self.described.is_fmi2:
                made = Fmi2(self.library, found, folder, name, is_logging=is_logging)
            else:
                made = Fmi3(
                    self.library,
                    found,
                    folder,
                    name,
                    is_logging=is_logging,
                    has_events=event_mode and self.has_events,
                    is_scheduled=self.described.is_scheduled,
                )
        except FmuError as error:
            raise FmuError(f"{self.described.name}: {error}", error.status) from error
        if is_only:
            _alive[token] = made
        return made

    def _needed(self) -> list[str]:
        described = self.described
        types = {one.function for one in described.variables.values()}
        settable = {one.function for one in described.variables.values() if one.has_start}
        if described.is_fmi2:
            needed, prefix = [*REQUIRED2], "fmi2"
        else:
            needed, prefix = [*REQUIRED3], "fmi3"
            needed += SCHEDULED if described.is_scheduled else CO_SIMULATION
            needed += EVENTS if self.has_events else ()
        needed += [f"{prefix}Get{one}" for one in sorted(types)]
        return needed + [f"{prefix}Set{one}" for one in sorted(settable)]

    def _drop_empty_promises(self) -> None:
        """Advertise no state that the binary has no functions for."""
        names = FMI2 if self.described.is_fmi2 else FMI3
        interface = self.described.interface
        if self.library.lacks(names.in_memory):
            interface.canGetAndSetFMUstate = False
        if not interface.canGetAndSetFMUstate or self.library.lacks(names.as_bytes):
            interface.canSerializeFMUstate = False


def _binary(described: Described) -> Path:
    """Return the library for this platform."""
    import fmpy

    platform = fmpy.platform if described.is_fmi2 else fmpy.platform_tuple
    identifier = described.interface.modelIdentifier
    file = described.folder / "binaries" / platform / f"{identifier}{fmpy.sharedLibraryExtension}"
    if not file.is_file():
        folder = described.folder / "binaries"
        found = sorted(one.name for one in folder.glob("*")) if folder.is_dir() else []
        raise ValueError(
            f"{described.name}: no binary for this platform, "
            f"got {', '.join(found) or 'none'}, expected binaries/{platform}/{file.name}"
        )
    return file
