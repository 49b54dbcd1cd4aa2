"""Bad FMUs: one line that names the file and what is wrong, exit code 2, and nothing left behind."""

import re
import tempfile

import pytest
from fmu_flights import complaints, flown, written
from fmus.archives import BAD, long_experiment, undeclared_output

from orchestrator.command.app import status

REASONS = {
    "not_a_zip": "zip",
    "empty": "zip",
    "truncated": "zip",
    "damaged": "damaged|checksum|CRC",
    "no_description": "modelDescription.xml",
    "broken_xml": "modelDescription.xml|XML",
    "invalid_description": "inptu",
    "wrong_guid": "instantiat|GUID|token",
    "no_binary": "riscv128-plan9|platform|binar",
    "bad_library": "library|binar",
    "fmi1": r"FMI 1\.0",
    "fmi4": r"4\.0",
    "model_exchange_only": "[Mm]odel.?[Ee]xchange",
    "path_traversal": "escaped.txt",
    "absolute_path": "escaped.txt",
    "symlink": "link",
    "zip_bomb": r"10[.0-9]* [GM]B",
    "lying_bomb": "damaged|size|bytes|large|CRC",
}


@pytest.fixture
def refused(tmp_path, monkeypatch, capfd):
    """Return a function that runs one FMU and returns the one line that it is refused with."""
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setenv("TMPDIR", str(temporary))
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))

    def run(use, **keys):
        before = {p for p in tmp_path.rglob("*") if p.is_file()}
        file = written(tmp_path, {"a": {"use": use, **keys}})
        out = tmp_path / "flight.mcap"
        assert status(["run", str(file), "--out", str(out)]) == 2
        printed = capfd.readouterr()
        assert printed.out == ""
        assert list(temporary.iterdir()) == []
        assert {p for p in tmp_path.rglob("*") if p.is_file()} - before <= {file}
        assert len(complaints(printed.err)) == 1, printed.err
        assert "Traceback" not in printed.err
        return printed.err

    return run


@pytest.mark.parametrize("isolation", ["none", "process"])
@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("name", BAD)
def test_bad_archives_are_refused(fmu, fmi, name, isolation, refused, tmp_path):
    """Whatever is wrong with the file, the line names it."""
    use = BAD[name](fmu("feedthrough", fmi=fmi), tmp_path)
    line = refused(use, rate_hz=10, isolation=isolation)
    assert use.name in line
    assert re.search(REASONS[name], line), line
    assert not list(tmp_path.parent.glob("**/escaped.txt"))


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_missing_function_is_named(fmu, fmi, refused):
    """A library without doStep cannot be stepped."""
    line = refused(fmu("relay", fmi=fmi, WITHOUT_STEP=1), rate_hz=10)
    assert f"fmi{fmi}DoStep" in line
    assert "relay.fmu" in line


def test_functions_of_other_interfaces_may_be_missing(fmu, tmp_path):
    """A co-simulation FMU need not export what is for model exchange."""
    recording = flown(tmp_path, {"a": {"use": fmu("relay", fmi=3, MINIMAL=1), "rate_hz": 10}})
    assert recording.result.outcome == "flown"


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_second_instance_in_a_process_is_refused_if_one_is_all(fmu, fmi, tmp_path, capfd):
    """Where the FMU says so, the line names the component and what helps: another process."""
    use = {"use": fmu("relay", fmi=fmi, ONCE=1), "rate_hz": 10}
    apart = {"a": use | {"isolation": "process"}, "b": use | {"isolation": "process"}}
    assert flown(tmp_path, apart).result.outcome == "flown"
    file = written(tmp_path, {"a": use, "b": use})
    assert status(["run", str(file), "--out", str(tmp_path / "again.mcap")]) == 2
    (line,) = complaints(capfd.readouterr().err)
    assert "components.b: relay.fmu: allows one instance per process" in line
    assert line.endswith("expected 'isolation: process'")


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_default_experiment_of_1e8_steps_is_refused(fmu, fmi, refused, tmp_path):
    """Where the scenario gives no rate, the FMU's own would make too many steps."""
    line = refused(long_experiment(fmu("relay", fmi=fmi), tmp_path))
    assert "too many steps, got 100000000, expected at most" in line


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_description_that_lacks_outputs_is_refused_or_flies(fmu, fmi, tmp_path, capfd):
    """ModelStructure without its outputs: one line that says so, or every input may matter."""
    use = undeclared_output(fmu("relay", fmi=fmi), tmp_path)
    file = written(tmp_path, {"a": {"use": use, "rate_hz": 10}})
    code = status(["run", str(file), "--out", str(tmp_path / "flight.mcap")])
    found = complaints(capfd.readouterr().err)
    assert code == 0 or (code == 2 and len(found) == 1 and "ModelStructure" in found[0])


def test_inspect_refuses_it_too(fmu, tmp_path, capfd):
    """Not only a run."""
    use = BAD["broken_xml"](fmu("relay"), tmp_path)
    assert status(["inspect", str(use)]) == 2
    error = capfd.readouterr().err
    assert len(complaints(error)) == 1
    assert "broken_xml.fmu" in error


def test_checking_what_cannot_be_made_is_one_line(tmp_path, capfd):
    """`hedgehop check` has no table for it: one line and exit code 2, as everywhere."""
    (tmp_path / "broken.fmu").write_bytes(b"PK\3\4 no more than this")
    assert status(["check", str(tmp_path / "broken.fmu")]) == 2
    printed = capfd.readouterr()
    assert printed.out == ""
    assert len(complaints(printed.err)) == 1
    assert "not an intact zip archive" in printed.err
