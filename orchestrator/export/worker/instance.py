"""One instance of an exported FMU: its component, how to make it anew, and its values in buffers."""

import math
import struct
from collections.abc import Mapping
from dataclasses import replace
from numbers import Integral
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, NamedTuple

TIMES = struct.Struct("=dd")
KINDS = {"reals": "fiu", "integers": "iu", "strings": "U"}  # of numpy, by buffer


def decode(value: Any, folder: Path) -> Any:
    """Return what ``recipe.encode`` has written."""
    if isinstance(value, list):
        return [decode(one, folder) for one in value]
    if not isinstance(value, dict):
        return value
    if "$file" in value:
        return folder / value["$file"]
    if "$tuple" in value:
        return tuple(decode(one, folder) for one in value["$tuple"])
    plain = {key: decode(one, folder) for key, one in value.items() if key != "$record"}
    return resolve_name(value["$record"])(**plain) if "$record" in value else plain


class Variable(NamedTuple):
    """Where a variable is in the buffers, and what its values mean: see ``rows.Row``."""

    name: str
    role: str  # set, field, latency_s, seed, time, get
    buffer: str
    at: int
    shape: tuple[int, ...]
    boolean: bool

    def read(self, buffers: Mapping[str, Any]) -> Any:
        """Return the value, as the component contract has it."""
        if self.shape:
            values = buffers[self.buffer][self.at : self.at + math.prod(self.shape)]
            kind = bool if self.boolean else str if self.buffer == "strings" else values.dtype
            return values.astype(kind).reshape(self.shape)
        value = buffers[self.buffer][self.at]
        if self.boolean:
            return bool(value)
        return str(value) if self.buffer == "strings" else value.item()

    def write(self, buffers: Mapping[str, Any], value: Any) -> None:
        """Put a value in its place.

        Raises
        ------
        ValueError
            If it has another shape or type, or something is lost.
        """
        import numpy as np

        array = np.asarray(value)
        if array.shape != self.shape:
            raise ValueError(f"{self.name}: wrong shape, got {array.shape}, expected {self.shape}")
        flat = array.ravel()
        place = buffers[self.buffer][self.at : self.at + flat.size]
        fits = array.dtype.kind in ("b" if self.boolean else KINDS[self.buffer])
        if fits:
            place[:] = flat
            pairs = zip(place.tolist(), flat.tolist(), strict=True)  # Python compares exactly
            fits = all(kept == one or one != one for kept, one in pairs)  # noqa: PLR0124  NaN
        if not fits:
            expected = (
                "bool" if self.boolean else place.dtype if self.buffer != "strings" else "str"
            )
            raise ValueError(f"{self.name}: wrong type, got {value!r}, expected {expected}")


class Buffers(NamedTuple):
    """All values by buffer, and for each variable whether the master set it since the last step."""

    values: dict[str, Any]
    changed: bytes


class Instance:
    """One component of an FMU, and how to make it anew."""

    def __init__(self, recipe: Mapping[str, Any], folder: Path, name: str) -> None:
        self.sizes: dict[str, list[int]] = recipe["sizes"]
        self.variables = [
            Variable(v["name"], v["role"], v["buffer"], v["at"], tuple(v["shape"]), v["boolean"])
            for v in recipe["variables"]
        ]
        self.outputs = [v for v in self.variables if v.role == "get"]
        self.names = [v.name for v in self.outputs]
        self.resources: dict[str, Any] = {}
        for one in recipe["resources"]:
            self.resources[one["name"]] = resolve_name(one["use"])(**self._arguments(one, folder))
        self.factory = resolve_name(recipe["component"]["use"])
        self.arguments = self._arguments(recipe["component"], folder)
        if "instance_name" in self.arguments:
            self.arguments["instance_name"] = name
        self.component: Any = self.factory(**self.arguments)
        self.state = "made"  # made, begun, failed
        self.span = 0.0, math.nan  # start and stop time, NaN if there is none

    def _arguments(self, call: Mapping[str, Any], folder: Path) -> dict[str, Any]:
        plain = {key: decode(value, folder) for key, value in call["arguments"].items()}
        return plain | {key: self.resources[name] for key, name in call["injected"].items()}

    def initialize(self, buffers: Buffers, start: float, stop: float) -> None:
        """Start from nothing with these values."""
        self.span = start, stop
        self._make(buffers, usable=("made",))
        self.set(buffers)
        self._begin(buffers)

    def restore(self, buffers: Buffers, state: bytes) -> None:
        """Go on from a state; the values are those of its time."""
        self.span = TIMES.unpack_from(state)
        self._make(buffers, usable=("made", "begun"))
        if self.state == "made":
            self._begin(buffers)
        self.component.set_state(state[TIMES.size :])

    def save(self) -> bytes:
        """Return everything that decides the future."""
        return TIMES.pack(*self.span) + self.component.get_state()

    def step(self, buffers: Buffers, time: float, step_size: float) -> int:
        """Advance the component with these inputs; its status.

        Raises
        ------
        ValueError
            If it answers something else.
        """
        self.set(buffers)
        answer = self.component.step(time, step_size)
        if isinstance(answer, bool) or not (isinstance(answer, Integral) and answer in range(5)):
            raise ValueError(f"step answered {answer!r}, expected a status 0 to 4")
        return int(answer)

    def get(self, buffers: Buffers) -> None:
        """Write all computed values."""
        values = self.component.get(self.names)
        for variable in self.outputs:
            variable.write(buffers.values, values[variable.name])

    def set(self, buffers: Buffers) -> None:
        """Set what the master has set since the last step."""
        values = {
            variable.name: variable.read(buffers.values)
            for variable, changed in zip(self.variables, buffers.changed, strict=True)
            if changed and variable.role == "set"
        }
        if values:
            self.component.set(values)

    def _begin(self, buffers: Buffers) -> None:
        self.state = "begun"
        start, stop = self.span
        seed = next(int(v.read(buffers.values)) for v in self.variables if v.role == "seed")
        stop_time = None if math.isnan(stop) else stop
        self.component.initialize(start_time=start, stop_time=stop_time, seed=seed)

    def _make(self, buffers: Buffers, usable: tuple[str, ...]) -> None:
        """Make a component of the present parameters, unless there is one in a usable state."""
        arguments = dict(self.arguments)
        for variable in self.variables:
            if variable.role == "latency_s":
                arguments["latency_s"] = variable.read(buffers.values)
            elif variable.role == "field":
                old = getattr(arguments["parameters"], variable.name)
                value = like(old, variable.read(buffers.values))
                if value != old:
                    record = replace(arguments["parameters"], **{variable.name: value})
                    arguments["parameters"] = record
        if arguments == self.arguments and self.state in usable:
            return
        component = self.factory(**arguments)
        if arguments != self.arguments:
            self._check(component)
        self.component, self.arguments, self.state = component, arguments, "made"

    def _check(self, component: Any) -> None:
        """Refuse parameters that change what the FMU has described."""
        described = {
            v.name: tuple(int(size.start) for size in v.dimensions)
            for v in component.describe().modelVariables
        }
        for variable in self.variables:
            expected = variable.shape if variable.role in ("set", "get") else None
            if expected is not None and described.get(variable.name) != expected:
                raise ValueError(
                    f"{variable.name}: other shape with these parameters, got "
                    f"{described.get(variable.name)}, expected {expected} as at the export"
                )


def like(old: Any, value: Any) -> Any:
    """Return a value in the nested tuples or lists, of the numbers, that the old one has."""
    if isinstance(old, tuple | list):
        return type(old)(like(one, item) for one, item in zip(old, value, strict=True))
    return type(old)(value)
