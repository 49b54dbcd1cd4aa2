"""Files that are there whole or not at all."""

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def whole(out: Path, source: Path) -> Generator[Path]:
    """Give the path to write to; what is there at the end takes the place of ``out``.

    If writing fails, nothing stays and ``out`` is what it was.

    Raises
    ------
    ValueError
        If ``out`` is what is read, ``source``.
    OSError
        If it cannot be written; the message names it.
    """
    if out.exists() and out.samefile(source):
        raise ValueError(f"{out}: is what is read, expected another file to write to")
    partial = out.with_name(f".{out.stem}.part{out.suffix}")
    try:
        yield partial
        partial.replace(out)
    except OSError as error:
        raise OSError(f"{out}: cannot be written, {error.strerror or error}") from error
    finally:
        partial.unlink(missing_ok=True)
