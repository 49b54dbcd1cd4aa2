"""Files that are there whole or not at all."""

from collections.abc import Generator, Iterable
from contextlib import contextmanager
from pathlib import Path


def refuse_source(out: Path, sources: Iterable[Path]) -> None:
    """Refuse to write over what is read.

    Raises
    ------
    ValueError
        If ``out`` is one of ``sources``.
    """
    if out.exists() and any(each.exists() and out.samefile(each) for each in sources):
        raise ValueError(f"{out}: is what is read, expected another file to write to")


@contextmanager
def whole(out: Path, *sources: Path) -> Generator[Path]:
    """Give the path to write to; what is there at the end takes the place of ``out``.

    If writing fails, nothing stays and ``out`` is what it was.

    Raises
    ------
    ValueError
        If ``out`` is one of those that are read, ``sources``.
    OSError
        If it cannot be written; the message names it. One that tells of another file stays as it is.
    """
    refuse_source(out, sources)
    partial = out.with_name(f".{out.stem}.part{out.suffix}")
    try:
        yield partial
        partial.replace(out)
    except OSError as error:
        if error.errno is None or (error.filename or partial) not in (partial, str(partial)):
            raise  # of reading
        raise OSError(f"{out}: cannot be written, {error.strerror or error}") from error
    finally:
        partial.unlink(missing_ok=True)
