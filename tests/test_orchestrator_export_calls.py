"""No order of calls, no argument and no death of the worker brings an exported FMU's host down."""

import os
import shutil
import subprocess
import sys
import time
import zipfile
from ctypes import byref, c_char_p, c_double, c_int, c_size_t, c_uint, c_void_p
from pathlib import Path

import fmpy
import pytest
from exported import EVERYTHING, VERSIONS, Master, exported, unpacked
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import fmi2CallbackFunctions

ERROR = 3


@pytest.fixture(scope="module", params=VERSIONS)
def master(request):
    """Return an instance of the small component; each test resets it."""
    made = Master(exported(EVERYTHING, request.param))
    yield made
    made.free()


def call(master, name, *arguments):
    """Return the status of a raw call with this instance."""
    function = master.fmu.dll[f"fmi{master.fmi}{name}"]  # not the one that FMPy has typed
    function.restype = c_int
    return function(c_void_p(master.fmu.component), *arguments)


def sized(master, n):
    """Return the number of values, which FMI 2 does not pass."""
    return (c_size_t(n),) if master.fmi == 3 else ()


def real(master):
    """Return the name of the type of real numbers."""
    return "Real" if master.fmi == 2 else "Float64"


def test_calls_out_of_order_are_errors(master):
    """Every call checks the life cycle, says what is wrong, and changes nothing."""
    master.fmu.reset()
    master.messages.clear()
    one, value = (c_uint * 1)(*master.references("total")), (c_double * 1)()
    refused = [
        ("ExitInitializationMode", ()),
        ("Terminate", ()),
        ("DoStep", (c_double(0.0), c_double(0.1), c_int(1), None, None, None, None)),
    ]
    if master.fmi == 2:
        refused.append(("GetReal", (one, c_size_t(1), value)))
    for name, arguments in refused:
        assert call(master, name, *arguments) == ERROR
        assert f"{name}: not permitted in state instantiated" in master.messages[-1][1]
    master.initialize(v=1.0)
    assert call(master, "ExitInitializationMode") == ERROR
    assert "not permitted in state step mode" in master.messages[-1][1]
    master.step(0.0, 0.1)
    master.fmu.terminate()
    assert master.get("total") == 0.1
    with pytest.raises(FMICallException):
        master.step(0.1, 0.1)


def test_wrong_steps_are_errors(master):
    """Times that do not follow on, step sizes that are none, and steps beyond the end are refused."""
    master.fmu.reset()
    master.initialize(stop=0.2, v=1.0)
    for t, h, expected in (
        (0.1, 0.1, "wrong time"), (float("nan"), 0.1, "wrong time"), (0.0, 0.0, "wrong step size"),
        (0.0, -0.1, "wrong step size"), (0.0, float("inf"), "wrong step size"),
        (0.0, float("nan"), "wrong step size"), (0.0, 0.3, "beyond the stop time"),
    ):  # fmt: skip
        with pytest.raises(FMICallException, match="status 3"):
            master.step(t, h)
        assert expected in master.messages[-1][1]
    master.step(0.0, 0.1)
    master.step(0.1 + 1e-12, 0.1)  # rounding of the master
    assert master.get("total") == pytest.approx(0.2)


def test_wrong_access_is_an_error_and_changes_nothing(master):
    """Unknown references, other types, null pointers, wrong sizes and read-only variables."""
    master.fmu.reset()
    master.initialize(v=0.25)
    kind = real(master)
    value = (c_double * 3)(7.0, 7.0, 7.0)
    (v,), (n,), (total,) = (master.references(name)[:1] for name in ("v", "n", "total"))
    (gain,) = master.references("gain")
    for references, message in (
        ([10**6], "unknown value reference"), ([2**32 - 1], "unknown value reference"),
        ([n], "another type"), ([v, 10**6], "unknown value reference"), ([v, n], "another type"),
    ):  # fmt: skip
        many = (c_uint * len(references))(*references)
        for verb in ("Get", "Set"):
            size = sized(master, len(references))
            status = call(master, verb + kind, many, c_size_t(len(references)), value, *size)
            assert status == ERROR
            assert message in master.messages[-1][1]
    for reference in (total, gain):  # computed, and fixed after initialization
        one = (c_uint * 1)(reference)
        assert call(master, f"Set{kind}", one, c_size_t(1), value, *sized(master, 1)) == ERROR
        assert "cannot be set in state step mode" in master.messages[-1][1]
    one = (c_uint * 1)(v)
    for verb in ("Get", "Set"):
        for arguments in (
            (None, c_size_t(1), value, *sized(master, 1)),
            (one, c_size_t(1), None, *sized(master, 1)),
        ):
            assert call(master, verb + kind, *arguments) == ERROR
            assert "null pointer" in master.messages[-1][1]
        assert call(master, verb + kind, None, c_size_t(0), None, *sized(master, 0)) == 0
    if master.fmi == 3:
        array = (c_uint * 1)(*master.references("u"))
        for count in (0, 1, 5, 7):
            assert call(master, "SetFloat64", array, c_size_t(1), value, c_size_t(count)) == ERROR
            assert f"got {count}, expected 6" in master.messages[-1][1]
    text = (c_uint * 1)(*master.references("text"))
    null = (c_char_p * 1)(None)
    assert call(master, "SetString", text, c_size_t(1), null, *sized(master, 1)) == ERROR
    master.step(0.0, 1.0)
    assert master.get("total") == 0.25


def test_wrong_states_are_errors(master):
    """State calls survive null pointers and sizes that are wrong."""
    master.fmu.reset()
    master.initialize()
    get, set_, serialize, deserialize, size_of, free = (
        ("GetFMUstate", "SetFMUstate", "SerializeFMUstate", "DeSerializeFMUstate",
         "SerializedFMUstateSize", "FreeFMUstate")
        if master.fmi == 2 else
        ("GetFMUState", "SetFMUState", "SerializeFMUState", "DeserializeFMUState",
         "SerializedFMUStateSize", "FreeFMUState")
    )  # fmt: skip
    state, size, content = c_void_p(), c_size_t(), (c_uint * 4096)()
    assert call(master, get, None) == ERROR
    assert call(master, set_, None) == ERROR
    assert call(master, free, None) == 0
    assert call(master, free, byref(state)) == 0
    assert call(master, get, byref(state)) == 0
    assert call(master, get, byref(state)) == 0  # into the same place again
    assert call(master, size_of, state, None) == ERROR
    assert call(master, size_of, None, byref(size)) == ERROR
    assert call(master, size_of, state, byref(size)) == 0
    assert call(master, serialize, state, content, c_size_t(size.value - 1)) == ERROR
    assert call(master, serialize, state, None, size) == ERROR
    assert call(master, serialize, state, content, size) == 0
    assert call(master, deserialize, None, size, byref(state)) == ERROR
    assert call(master, deserialize, content, size, None) == ERROR
    content[200] ^= 0xFFFF  # the values may be anything: they are numbers
    assert call(master, deserialize, content, size, byref(state)) == 0
    assert call(master, free, byref(state)) == 0
    assert state.value is None


def test_what_an_fmu_does_not_have_is_an_error(master):
    """Functions of other interface types, derivatives and clocks answer Error, with a reason."""
    master.fmu.reset()
    master.initialize()
    names = {
        2: ("CancelStep", "SetRealInputDerivatives", "GetRealOutputDerivatives",
            "GetDirectionalDerivative"),
        3: ("EnterEventMode", "EnterStepMode", "UpdateDiscreteStates", "GetClock", "GetBinary",
            "EnterConfigurationMode", "GetDirectionalDerivative", "GetAdjointDerivative",
            "GetOutputDerivatives", "SetTime", "ActivateModelPartition"),
    }  # fmt: skip
    for name in names[master.fmi]:
        master.messages.clear()
        assert call(master, name, *[None] * 9) == ERROR
        assert len(master.messages) == 1
        assert master.messages[0][1].startswith(f"fmi{master.fmi}{name}: ")


def test_a_null_instance_is_an_error(master):
    """Nothing is called through a null pointer."""
    library = master.fmu.dll
    for name in ("Terminate", "Reset", "ExitInitializationMode", "DoStep", "GetString"):
        function = library[f"fmi{master.fmi}{name}"]
        function.restype = c_int
        assert function(*[None] * 8) == ERROR
    free = library[f"fmi{master.fmi}FreeInstance"]
    free.restype = None
    free(None)


def test_instantiate_refuses_what_it_cannot_do():
    """A wrong token, name, type or resource folder gives NULL and a reason."""
    folder, description = unpacked(exported(EVERYTHING, 2))
    made = Master(exported(EVERYTHING, 2))
    instantiate = made.fmu.dll["fmi2Instantiate"]
    instantiate.restype = c_void_p
    token, place = description.guid.encode(), (folder / "resources").as_uri().encode()
    callbacks = byref(made._callbacks)
    for arguments, expected in (
        ((b"x", 1, b"wrong", place), "wrong token, got 'wrong'"),
        ((b"x", 1, None, place), "wrong token, got ''"),
        ((b"", 1, token, place), "no name"),
        ((None, 1, token, place), "no name"),
        ((b"x", 0, token, place), "expected fmi2CoSimulation"),
        ((b"x", 1, token, None), "no resource folder"),
        ((b"x", 1, token, b"http://there/resources"), "no resource folder"),
        ((b"x", 1, token, b"file:///nowhere%20at/all"), "the worker ended during start"),
    ):
        name, kind, *rest = arguments
        found = instantiate(
            c_char_p(name), c_int(kind), *map(c_char_p, rest), callbacks, c_int(0), c_int(0)
        )
        assert found is None
        assert expected in made.messages[-1][1]
    assert instantiate(c_char_p(b"x"), c_int(1), c_char_p(token), c_char_p(place), None) is None
    nobody = fmi2CallbackFunctions()  # no logger
    assert (
        instantiate(c_char_p(b"x"), c_int(1), c_char_p(b""), c_char_p(place), byref(nobody)) is None
    )
    made.free()


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("exit", "ended during a step, with exit code 7"),
        ("abort", "died during a step, of signal 6"),
    ],
)
@pytest.mark.parametrize("fmi", VERSIONS)
def test_a_dead_worker_is_fatal(fmi, text, reason):
    """When the component's process dies the step is Fatal, says how, and nothing else happens."""
    made = Master(exported(EVERYTHING, fmi))
    made.initialize(text=text)
    with pytest.raises(FMICallException, match="status 4"):
        made.step(0.0, 0.1)
    assert reason in made.messages[-1][1]
    with pytest.raises(FMICallException, match="status 3"):
        made.step(0.0, 0.1)
    made.free()


def _descriptors():
    """Return the open file descriptors of this process, by what they are."""
    found = Path("/proc/self/fd").glob("*")
    return {(file.name, str(file.readlink())) for file in found if file.is_symlink()}


def _children(parent):
    """Return the processes that are children of one, zombies too."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()  # state, parent, ...
        except OSError:
            continue  # gone
        if int(fields[1]) == parent:
            found.append(int(stat.parent.name))
    return sorted(found)


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize("fmi", VERSIONS)
def test_nothing_is_left_after_free(fmi):
    """No process, no zombie and no file descriptor outlives an instance, dead or alive."""
    processes = _children(os.getpid())
    for text in ("", "exit", "hang"):
        before = _descriptors()
        made = Master(exported(EVERYTHING, fmi))
        made.initialize(text=text)
        if text != "hang":
            if text:
                with pytest.raises(FMICallException):
                    made.step(0.0, 0.1)
            made.free()
        else:
            made.fmu.reset()
            made.free()  # without having terminated
        assert _descriptors() == before
        assert _children(os.getpid()) == processes


def test_the_folder_of_an_fmu_stays_as_it_was():
    """Running it leaves nothing where the host has unpacked it, not even compiled Python."""
    file = exported(EVERYTHING, 3)
    made = Master(file)
    made.initialize()
    made.free()
    with zipfile.ZipFile(file) as archive:
        members = set(archive.namelist())
    found = (one for one in made.folder.rglob("*") if one.is_file())
    assert {one.relative_to(made.folder).as_posix() for one in found} == members


HOST = """
import sys
sys.path.insert(0, {tests!r})
from exported import Master, unpacked
import exported
exported._FOLDER.cleanup()
from pathlib import Path
exported.unpacked = lambda file: (Path({folder!r}), exported.fmpy.read_model_description({folder!r}))
made = Master(None)
made.initialize(text="hang")
print("in the step", flush=True)
made.step(0.0, 0.1)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_the_worker_ends_when_its_host_dies():
    """A host that is killed in a step leaves no worker behind, even one that hangs."""
    folder, _ = unpacked(exported(EVERYTHING, 3))
    code = HOST.format(tests=str(Path(__file__).parent), folder=str(folder))
    host = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert host.stdout.readline() == "in the step\n"
    (worker,) = _children(host.pid)
    time.sleep(0.2)  # in the step
    host.kill()
    host.wait()
    host.stdout.close()
    for _ in range(100):
        if not Path(f"/proc/{worker}").exists():
            return
        time.sleep(0.1)
    pytest.fail(f"worker {worker} is alive")


def test_a_missing_interpreter_or_package_is_one_line(monkeypatch, tmp_path):
    """HEDGEHOP_PYTHON chooses the interpreter; what it lacks is said by the FMI log."""
    file = exported("small_exports:Missing", 3)
    said = []

    def attempt():
        said.clear()
        folder, description = unpacked(file)
        with pytest.raises(Exception, match="Failed to instantiate"):
            fmpy.instantiate_fmu(str(folder), description, "CoSimulation",
                                 logger=lambda *rest: said.append(rest[-1].decode()))  # fmt: skip
        return said

    monkeypatch.setenv("SMALL_EXPORTS_MISSING", "1")
    first, where = attempt()
    assert first == "ModuleNotFoundError: No module named 'a_package_that_nobody_has'"
    assert where.startswith("the component cannot be made by ")
    monkeypatch.setenv("HEDGEHOP_PYTHON", str(tmp_path / "python"))
    (line,) = attempt()
    assert line.startswith(f"no Python interpreter, got '{tmp_path / 'python'}' (No such file")
    monkeypatch.setenv("HEDGEHOP_PYTHON", "/bin/false")
    (line,) = attempt()
    assert line == "the worker ended during start, with exit code 1"
    sleeper = tmp_path / "sleeper"
    sleeper.write_text("#!/bin/sh\nexec sleep 60\n")
    sleeper.chmod(0o755)
    monkeypatch.setenv("HEDGEHOP_PYTHON", str(sleeper))
    monkeypatch.setenv("HEDGEHOP_START_TIMEOUT_S", "0.2")
    (line,) = attempt()
    assert line.startswith("the worker did not start within 0.2 s")


def test_a_host_in_c_runs_an_fmu(tmp_path):
    """A program without Python loads the library, steps two instances and ends cleanly."""
    compiler = shutil.which("cc")
    assert compiler is not None
    folder, description = unpacked(exported(EVERYTHING, 2))
    headers = Path(fmpy.__file__).parent / "c-code"
    source = Path(__file__).parent / "host.c"
    subprocess.run([compiler, "-std=c99", "-Wall", "-Wextra", "-Werror", f"-I{headers}", source,
                    "-o", "host", "-ldl"], cwd=tmp_path, check=True)  # fmt: skip
    references = {v.name: v.valueReference for v in description.modelVariables}
    (library,) = (folder / "binaries").glob("*/*")
    done = subprocess.run(
        ["./host", library, description.guid, (folder / "resources").as_uri(),
         str(references["v"]), str(references["total"])],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    total = 0.0
    for _ in range(10):
        total += 0.1 * 0.5
    assert (done.returncode, done.stderr) == (0, "")
    assert [float(line) for line in done.stdout.split()] == [total, total]
