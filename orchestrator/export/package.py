"""Compile an FMU's library and put the archive together."""

import hashlib
import os
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING
from uuid import UUID

from orchestrator.component import Execution
from orchestrator.export.header import model_header
from orchestrator.export.rows import Row
from orchestrator.export.xml import Abilities, model_description_xml

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription

FRONT = ("backend.h", "instance.h", "instance.c")
EPOCH = (1980, 1, 1, 0, 0, 0)  # the first that a zip archive can say


@dataclass(frozen=True)
class BackEnd:
    """What is behind an FMU's front end.

    Attributes
    ----------
    sources : mapping
        C files of the back end, by name.
    resources : mapping
        Files of the FMU's resources, by path.
    abilities : Abilities
    python : str
        The interpreter to look for first, if any is needed.
    """

    sources: Mapping[str, str]
    abilities: Abilities
    resources: Mapping[str, bytes] = field(default_factory=dict[str, bytes])
    python: str = ""


def c_file(name: str) -> str:
    """Return the text of one of the C files here."""
    return (Path(__file__).parent / "c" / name).read_text(encoding="utf-8")


def package(
    out: Path,
    description: "ModelDescription",
    found: Sequence[Row],
    execution: Execution,
    back_end: BackEnd,
    *,
    fmi: int,
    tool: str,
) -> None:
    """Write an FMU.

    Raises
    ------
    ValueError
        If there is no C compiler, it fails, or the FMU would not be valid.
    """
    identifier = "".join(
        c if c.isascii() and c.isalnum() else "_" for c in str(description.modelName)
    )
    names = (*FRONT, f"fmi{fmi}.c")
    sources = {name: c_file(name) for name in names} | dict(back_end.sources)
    units = sorted(name for name in sources if name.endswith(".c"))
    content = hashlib.sha256()

    def header(token: str) -> str:
        feeds = execution.kind == "continuous" and any(
            row.causality == "output" and row.depends_on != () for row in found
        )
        return model_header(found, fmi=fmi, token=token, abilities=back_end.abilities,
                            feedthrough=feeds, python=back_end.python)  # fmt: skip

    def xml(token: str) -> bytes:
        return model_description_xml(
            description, found, fmi=fmi, identifier=identifier, token=token, tool=tool,
            abilities=back_end.abilities, execution=execution, sources=units,
        )  # fmt: skip

    parts = {**{k: v.encode() for k, v in sources.items()}, **back_end.resources}
    for name, part in sorted({**parts, "model.h": header("").encode(), "": xml("")}.items()):
        content.update(f"{name}\0{len(part)}\0".encode())
        content.update(part)
    token = str(UUID(bytes=content.digest()[:16]))
    sources["model.h"] = header(token)
    library, place = _compiled(identifier, sources, units, fmi)
    members = {"modelDescription.xml": xml(token), place: library}
    members |= {f"resources/{name}": part for name, part in back_end.resources.items()}
    members |= {f"sources/{name}": text.encode() for name, text in sources.items()}
    if fmi == 3:
        members["sources/buildDescription.xml"] = _build_description(identifier, units)
    archived(out, members, _validate)


def archived(
    out: Path, members: Mapping[str, bytes], accept: Callable[[Path], None] = lambda _: None
) -> None:
    """Write a zip archive, whole or not at all; equal members give equal bytes.

    ``accept`` raises for an archive that is not to be kept.
    """
    partial = out.with_name(out.name + ".part")
    try:
        with zipfile.ZipFile(partial, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, part in sorted(members.items()):
                information = zipfile.ZipInfo(name, EPOCH)
                information.compress_type = zipfile.ZIP_DEFLATED
                information.external_attr = 0o644 << 16
                archive.writestr(information, part)
        accept(partial)
        partial.replace(out)
    finally:
        partial.unlink(missing_ok=True)


def _validate(file: Path) -> None:
    """Refuse what FMPy refuses; names are checked before, since a name takes it 5 ms."""
    from fmpy import read_model_description
    from fmpy.model_description import ValidationError

    try:
        read_model_description(str(file), validate_model_structure=True)
    except ValidationError as error:
        raise ValueError(f"the FMU would not be valid: {'; '.join(error.problems)}") from error


def _compiled(
    identifier: str, sources: Mapping[str, str], units: Sequence[str], fmi: int
) -> tuple[bytes, str]:
    """Return the shared library and its place in the FMU."""
    import fmpy

    if sys.platform == "win32":
        raise ValueError("export: not supported on Windows, expected Linux or macOS")
    compiler = os.environ.get("CC") or next(filter(shutil.which, ("cc", "gcc", "clang")), None)
    if compiler is None:
        raise ValueError("export: no C compiler, expected cc, gcc or clang on PATH, or CC")
    headers = Path(fmpy.__file__).parent / "c-code"
    with TemporaryDirectory() as folder:
        for name, text in sources.items():
            (Path(folder) / name).write_text(text, encoding="utf-8")
        # relative names and no debug information: equal sources give equal bytes
        target = identifier + fmpy.sharedLibraryExtension
        command = [*compiler.split(), "-std=c99", "-O2", "-fPIC", "-shared", f"-I{headers}", "-I.",
                   *units, "-o", target, "-lm"]  # fmt: skip
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)  # noqa: S603
        if done.returncode:
            lines = [line for line in done.stderr.splitlines() if "error" in line]
            raise ValueError(f"export: {compiler} failed: {(lines or ['no message'])[0]}")
        library = (Path(folder) / target).read_bytes()
    place = fmpy.platform if fmi == 2 else fmpy.platform_tuple
    return library, f"binaries/{place}/{target}"


def _build_description(identifier: str, units: Sequence[str]) -> bytes:
    files = "\n".join(f'      <SourceFile name="{name}"/>' for name in units)
    return f"""\
<?xml version="1.0" encoding="UTF-8"?>
<fmiBuildDescription fmiVersion="3.0">
  <BuildConfiguration modelIdentifier="{identifier}">
    <SourceFileSet language="C99">
{files}
    </SourceFileSet>
  </BuildConfiguration>
</fmiBuildDescription>
""".encode()
