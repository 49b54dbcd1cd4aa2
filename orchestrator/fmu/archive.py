"""Unpack an FMU safely: nothing is written until the whole archive has been looked at."""

import stat
import zipfile
from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory

from orchestrator.errors import nearest

DESCRIPTION = "modelDescription.xml"
NEEDED = (DESCRIPTION, "binaries", "resources")  # what a simulation reads; the rest stays packed
MOST_BYTES = 8 << 30  # of all members together
SMALL_BYTES = 100 << 20  # below this no ratio is suspicious
MOST_RATIO = 200  # of unpacked to packed size; deflate cannot exceed 1032


def is_unpacked(path: Path) -> bool:
    """Return whether a path is the folder of an unpacked FMU."""
    return (path / DESCRIPTION).is_file()


def unpack(
    file: Path, only: Sequence[str] | None = None
) -> tuple[Path, TemporaryDirectory[str] | None]:
    """Return the folder of an FMU, and its owner if it is a temporary one.

    An unpacked FMU is used where it is. Documentation, sources and licences are not unpacked.

    Parameters
    ----------
    only : sequence of str, optional
        Members to unpack instead of everything that a simulation needs.

    Raises
    ------
    ValueError
        If there is no such file, or it is not an archive that can be unpacked without harm.
    """
    if file.is_dir():
        if not is_unpacked(file):
            raise ValueError(f"{file.name}: not an FMU, got a folder without {DESCRIPTION}")
        return file.absolute(), None
    if not file.is_file():
        known = [one.name for one in file.parent.glob("*")] if file.parent.is_dir() else []
        raise ValueError(f"{file.name}: file not found{nearest(file.name, known)}")
    try:
        with zipfile.ZipFile(file) as archive:
            return _extracted(archive, file.name, only)
    except zipfile.BadZipFile as error:
        raise ValueError(f"{file.name}: not an intact zip archive, {_line(error)}") from error
    except (RuntimeError, NotImplementedError) as error:  # encrypted, or of another compression
        raise ValueError(f"{file.name}: cannot be unpacked, {_line(error)}") from error


def _extracted(
    archive: zipfile.ZipFile, name: str, only: Sequence[str] | None
) -> tuple[Path, TemporaryDirectory[str]]:
    members = archive.infolist()
    for member in members:
        if fault := _fault(member):
            raise ValueError(f"{name}: unsafe archive, member {member.filename!r} {fault}")
    size = sum(member.file_size for member in members)
    packed = max(1, sum(member.compress_size for member in members))
    if size > MOST_BYTES or (size > SMALL_BYTES and size > MOST_RATIO * packed):
        raise ValueError(
            f"{name}: unsafe archive, too large, got {size / 1e9:.3g} GB unpacked from "
            f"{packed / 1e9:.3g} GB, expected at most {MOST_BYTES / 1e9:.3g} GB and "
            f"{MOST_RATIO} times its size"
        )
    if DESCRIPTION not in archive.namelist():
        raise ValueError(f"{name}: not an FMU, got an archive without {DESCRIPTION}")
    folder = TemporaryDirectory(prefix="hedgehop-fmu-", ignore_cleanup_errors=True)
    try:
        for member in members:
            is_needed = PurePosixPath(member.filename).parts[0] in NEEDED
            if is_needed if only is None else member.filename in only:
                archive.extract(member, folder.name)
    except BaseException:
        folder.cleanup()
        raise
    return Path(folder.name), folder


def _fault(member: zipfile.ZipInfo) -> str | None:
    """Return why a member must not be unpacked, if so."""
    path = PurePosixPath(member.orig_filename)
    if "\\" in member.orig_filename or ":" in member.orig_filename:
        return "has a backslash or a drive in its path"
    if path.is_absolute() or ".." in path.parts or not path.parts:
        return "leaves the archive's folder"
    if stat.S_ISLNK(member.external_attr >> 16):
        return "is a link"
    return None


def _line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
