"""What a component's exception is told as: the call, the exception, and where in its own code."""

import os
import sys
import traceback
from inspect import getattr_static
from pathlib import PurePath
from traceback import walk_tb
from types import CodeType, FrameType
from typing import Any


class Origin(Exception):  # noqa: N818
    """How an exception was raised in another process; its cause in this one.

    Attributes
    ----------
    call, place : str
        As :func:`failure` would tell them over there; ``call`` is empty where nothing was called.
    """

    def __init__(self, text: str, call: str, place: str) -> None:
        super().__init__(text)
        self.call = call
        self.place = place

    def __str__(self) -> str:
        return f"\n{self.args[0]}"


def failure(error: BaseException, component: object, call: str) -> str:
    """Return ``step failed, ZeroDivisionError: division by zero (pid.py:9)``, in one line.

    ``component`` is what was called, or the factory of one in its ``constructor``: where nothing of
    its own code ran, because the arguments do not fit, the place is where that begins.
    """
    origin = error.__cause__
    if isinstance(origin, Origin):
        call = origin.call or call
    what = f"{type(error).__name__}: {_line(error)}".removesuffix(": ")
    told = f"{call} failed, {what}" if call else what
    return f"{told}{place(error, _callee(component, call))}"


def refusal(error: BaseException, component: object, call: str) -> str:
    """Return what a ValueError says, and where: so a component refuses; else its ``failure``."""
    origin = error.__cause__
    is_deep = isinstance(origin, Origin) and origin.call not in ("", call)
    if is_deep or not isinstance(error, ValueError):
        return failure(error, component, call)
    return f"{_line(error)}{place(error, _callee(component, call))}"


def place(error: BaseException, callee: object = None) -> str:
    """Return `` (pid.py:9)``, where in a component's own code; empty if that is ours or unknown.

    Its own code is the package in which the first frame beyond ours runs, and whatever lies in or
    below the same folder; the innermost frame counts. Without any it is where ``callee`` begins.
    """
    if isinstance(error.__cause__, Origin):
        return error.__cause__.place
    frames = [(f, line) for f, line in walk_tb(error.__traceback__) if not _is_ours(_module(f))]
    if frames:
        first = frames[0][0]
        frame, line = [one for one in frames if _is_beside(one[0], first)][-1]
        return f" ({_name(frame.f_code)}:{line})"
    method: Any = getattr(callee, "__init__", None) if isinstance(callee, type) else callee
    code = getattr(getattr(method, "__func__", method), "__code__", None)
    if not isinstance(code, CodeType) or _is_ours(str(getattr(method, "__module__", ""))):
        return ""
    return f" ({_name(code)}:{code.co_firstlineno})"


def show(error: BaseException) -> None:
    """Print the traceback of a component's exception where HEDGEHOP_TRACEBACK=1 asks for it."""
    if os.environ.get("HEDGEHOP_TRACEBACK") == "1":
        traceback.print_exception(error, file=sys.stderr)


def _callee(component: object, call: str) -> object:
    """Return the method of a call; the class or function itself if it is what makes components."""
    return component if call == "constructor" else getattr_static(component, call or "_", None)


def _is_beside(frame: FrameType, first: FrameType) -> bool:
    folder = PurePath(first.f_code.co_filename).parent
    return (
        _module(frame).partition(".")[0] == _module(first).partition(".")[0]
        or folder in PurePath(frame.f_code.co_filename).parents
    )


def _is_ours(module: str) -> bool:
    return module.partition(".")[0] == __name__.partition(".")[0]


def _module(frame: FrameType) -> str:
    return str(frame.f_globals.get("__name__", ""))


def _name(code: CodeType) -> str:
    return PurePath(code.co_filename).name


def _line(error: BaseException) -> str:
    try:
        return " ".join(str(error).split())
    except Exception:  # noqa: BLE001  (of the exception's own making)
        return ""
