"""Tell arrays that the other process has already from new ones."""

from typing import Any

from numpy.typing import NDArray

from orchestrator.component import Value


def is_new(last: dict[str, NDArray[Any]], name: str, array: NDArray[Any]) -> bool:
    """Return whether ``array`` differs in any bit from the last one of that name; note it in ``last``.

    What is noted is never changed later: it is read-only, or a copy.
    """
    known = last.get(name)
    is_fixed = not array.flags.writeable
    if known is array and is_fixed:
        return False
    is_same = (
        known is not None
        and known.dtype == array.dtype
        and known.shape == array.shape
        and known.tobytes() == array.tobytes()
    )
    if is_fixed or not is_same:
        last[name] = array if is_fixed else frozen(array.copy())
    return not is_same


def frozen(value: Value) -> Any:
    """Return an array made read-only, anything else as it is."""
    flags = getattr(value, "flags", None)
    if flags is not None:
        flags.writeable = False
    return value
