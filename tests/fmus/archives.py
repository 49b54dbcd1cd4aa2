"""Archives that are no FMU to run, made from a good one: every way in which a file can be bad."""

import stat
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

Entries = dict[str, bytes]


def _rewritten(fmu: Path, folder: Path, name: str, change: Callable[[Entries], None]) -> Path:
    """Return a copy of an FMU whose members have been changed."""
    with zipfile.ZipFile(fmu) as archive:
        entries = {member: archive.read(member) for member in archive.namelist()}
    change(entries)
    made = folder / f"{name}.fmu"
    with zipfile.ZipFile(made, "w") as archive:
        for member, data in entries.items():
            archive.writestr(member, data)
    return made


def _description(fmu: Path, folder: Path, name: str, old: str, new: str) -> Path:
    """Return a copy of an FMU with one passage of its description replaced."""

    def change(entries: Entries) -> None:
        text = entries["modelDescription.xml"].decode()
        if old not in text:
            raise ValueError(f"{fmu}: no {old!r} in the description")
        entries["modelDescription.xml"] = text.replace(old, new).encode()

    return _rewritten(fmu, folder, name, change)


def not_a_zip(fmu: Path, folder: Path) -> Path:
    """Return a text file."""
    made = folder / "not_a_zip.fmu"
    made.write_text("This is a letter, not an archive.\n")
    return made


def empty(fmu: Path, folder: Path) -> Path:
    """Return a file of no bytes."""
    made = folder / "empty.fmu"
    made.write_bytes(b"")
    return made


def truncated(fmu: Path, folder: Path) -> Path:
    """Return the first half of the file."""
    made = folder / "truncated.fmu"
    data = fmu.read_bytes()
    made.write_bytes(data[: len(data) // 2])
    return made


def damaged(fmu: Path, folder: Path) -> Path:
    """Return a file one byte of whose library is not what its checksum says."""
    made = folder / "damaged.fmu"
    data = bytearray(fmu.read_bytes())
    with zipfile.ZipFile(fmu) as archive:
        info = next(i for i in archive.infolist() if i.filename.startswith("binaries/"))
    data[info.header_offset + 30 + len(info.filename) + info.file_size // 2] ^= 0xFF
    made.write_bytes(data)
    return made


def no_description(fmu: Path, folder: Path) -> Path:
    """Return an archive without modelDescription.xml."""
    return _rewritten(
        fmu, folder, "no_description", lambda e: e.pop("modelDescription.xml") and None
    )


def broken_xml(fmu: Path, folder: Path) -> Path:
    """Return an FMU whose description is cut short."""

    def change(entries: Entries) -> None:
        xml = entries["modelDescription.xml"]
        entries["modelDescription.xml"] = xml[: len(xml) // 2]

    return _rewritten(fmu, folder, "broken_xml", change)


def invalid_description(fmu: Path, folder: Path) -> Path:
    """Return an FMU with an illegal causality: well-formed, but not by the schema."""
    old, new = 'causality="input"', 'causality="inptu"'
    return _description(fmu, folder, "invalid_description", old, new)


def undeclared_output(fmu: Path, folder: Path) -> Path:
    """Return an FMU whose ModelStructure lacks its outputs."""

    def change(entries: Entries) -> None:
        text = entries["modelDescription.xml"].decode()
        start, end = text.index("<ModelStructure>"), text.index("</ModelStructure>")
        entries["modelDescription.xml"] = (text[:start] + "<ModelStructure>" + text[end:]).encode()

    return _rewritten(fmu, folder, "undeclared_output", change)


def wrong_guid(fmu: Path, folder: Path) -> Path:
    """Return an FMU whose description belongs to another binary."""
    name = fmu.stem
    return _description(fmu, folder, "wrong_guid", f'"{{{name}-', f'"{{other-{name}-')


def no_binary(fmu: Path, folder: Path) -> Path:
    """Return an FMU for a platform that this machine is not."""

    def change(entries: Entries) -> None:
        for member in [m for m in entries if m.startswith("binaries/")]:
            entries["binaries/riscv128-plan9/" + Path(member).name] = entries.pop(member)

    return _rewritten(fmu, folder, "no_binary", change)


def bad_library(fmu: Path, folder: Path) -> Path:
    """Return an FMU whose binary is text."""

    def change(entries: Entries) -> None:
        for member in [m for m in entries if m.startswith("binaries/")]:
            entries[member] = b"not a library"

    return _rewritten(fmu, folder, "bad_library", change)


def fmi1(fmu: Path, folder: Path) -> Path:
    """Return an FMU that says it is of FMI 1.0."""
    made = folder / "fmi1.fmu"
    xml = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="1.0" modelName="old" modelIdentifier="old" guid="{1}"
 numberOfContinuousStates="0" numberOfEventIndicators="0">
<ModelVariables><ScalarVariable name="y" valueReference="0" causality="output"><Real/>
</ScalarVariable></ModelVariables>
<Implementation><CoSimulation_StandAlone><Capabilities/></CoSimulation_StandAlone></Implementation>
</fmiModelDescription>
"""
    with zipfile.ZipFile(made, "w") as archive:
        archive.writestr("modelDescription.xml", xml)
    return made


def fmi4(fmu: Path, folder: Path) -> Path:
    """Return an FMU of a version that does not exist yet."""
    version = "2.0" if b'fmiVersion="2.0"' in _xml(fmu) else "3.0"
    old, new = f'fmiVersion="{version}"', 'fmiVersion="4.0"'
    return _description(fmu, folder, "fmi4", old, new)


def model_exchange_only(fmu: Path, folder: Path) -> Path:
    """Return an FMU that must be integrated by whoever runs it."""

    def change(entries: Entries) -> None:
        text = entries["modelDescription.xml"].decode()
        start = text.index("<CoSimulation")
        end = text.index("/>", start)
        element = f'<ModelExchange modelIdentifier="{fmu.stem}"'
        entries["modelDescription.xml"] = (text[:start] + element + text[end:]).encode()

    return _rewritten(fmu, folder, "model_exchange_only", change)


def long_experiment(fmu: Path, folder: Path) -> Path:
    """Return an FMU whose default experiment has 1e8 steps."""
    old, new = "stopTime='1'", "stopTime='1' stepSize='1e-8'"
    return _description(fmu, folder, "long_experiment", old, new)


def path_traversal(fmu: Path, folder: Path) -> Path:
    """Return an FMU one of whose members lies outside of the archive."""

    def change(entries: Entries) -> None:
        entries["../escaped.txt"] = b"out"
        entries["resources/../../../escaped.txt"] = b"out"

    return _rewritten(fmu, folder, "path_traversal", change)


def absolute_path(fmu: Path, folder: Path) -> Path:
    """Return an FMU with a member that names a place on this machine."""
    target = str(folder / "escaped.txt")
    return _rewritten(fmu, folder, "absolute_path", lambda e: e.update({target: b"out"}))


def symlink(fmu: Path, folder: Path) -> Path:
    """Return an FMU with a member that is a link to the machine's password file."""
    made = _rewritten(fmu, folder, "symlink", lambda e: None)
    link = zipfile.ZipInfo("resources/link")
    link.create_system = 3
    link.external_attr = (stat.S_IFLNK | 0o777) << 16
    with zipfile.ZipFile(made, "a") as archive:
        archive.writestr(link, "/etc/passwd")
    return made


def zip_bomb(fmu: Path, folder: Path) -> Path:
    """Return an FMU of some 10 MB that becomes 10 GB: a member of zeros, named over and over.

    The members share one compressed stream: only the directory is made by hand.
    """
    made = _rewritten(fmu, folder, "zip_bomb", lambda e: None)
    with zipfile.ZipFile(made, "a", zipfile.ZIP_DEFLATED) as archive:
        with archive.open("resources/zeros", "w", force_zip64=True) as member:
            block = bytes(2**20)
            for _ in range(16):
                member.write(block)
        info = archive.getinfo("resources/zeros")
        for index in range(640):
            copy = zipfile.ZipInfo(f"resources/zeros{index:03d}")
            for key in ("header_offset", "CRC", "compress_size", "file_size", "compress_type"):
                setattr(copy, key, getattr(info, key))
            archive.filelist.append(copy)
            archive.NameToInfo[copy.filename] = copy
        archive._didModify = True  # the directory is written anew on close
    return made


def lying_bomb(fmu: Path, folder: Path) -> Path:
    """Return an FMU with 16 MB of zeros whose directory says that they are 100 bytes."""
    made = _rewritten(fmu, folder, "lying_bomb", lambda e: None)
    with zipfile.ZipFile(made, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("resources/zeros", bytes(2**24))
    data = bytearray(made.read_bytes())
    true, false = struct.pack("<I", 2**24), struct.pack("<I", 100)
    made.write_bytes(bytes(data).replace(true, false))
    return made


def _xml(fmu: Path) -> bytes:
    with zipfile.ZipFile(fmu) as archive:
        return archive.read("modelDescription.xml")


BAD = {
    make.__name__: make
    for make in (
        not_a_zip, empty, truncated, damaged, no_description, broken_xml, invalid_description,
        wrong_guid, no_binary, bad_library, fmi1, fmi4, model_exchange_only, path_traversal,
        absolute_path, symlink, zip_bomb, lying_bomb,
    )
}  # fmt: skip
