"""FMUs coupled at several rates give the answers that can be written down, to the last bit.

Closed forms, or the same few additions in Python; FMI 2 and FMI 3, in process and isolated.
"""

import zipfile

import numpy as np
import pytest
from fmu_flights import flown, kinds

from orchestrator.recording.diff import diff

pytestmark = [
    pytest.mark.parametrize("fmi", [2, 3]),
    pytest.mark.parametrize("isolation", ["none", "process"]),
]


@pytest.fixture
def part(fmu, fmi, isolation):
    """Return a function that returns the keys of a component of a model."""

    def keys_of(model, rate_hz, more=None, **defines):
        made = {"use": fmu(model, fmi=fmi, **defines), "isolation": isolation, **(more or {})}
        return made | ({"rate_hz": rate_hz} if rate_hz else {})

    return keys_of


def assert_signal(recording, name, expected):
    """Assert that a signal is a function of time, at its own instants, to the last bit."""
    times, values = recording[name]
    ticks = np.round(times * 1000).astype(int)  # ms: exact
    np.testing.assert_array_equal(values, [expected(int(ms)) for ms in ticks])


def test_a_slow_output_is_never_visible_early(part, tmp_path):
    """The step of 0.5 s ends at 0.5 s: the fast side uses it from its step 0.50 to 0.55 s on.

    The trap of reference 3.4: there are masters that show it at 0.05 s.
    """
    components = {
        "slow": part("staircase", 2, PERIOD=0.5),
        "fast": part("relay", 20),
        "sum": part("integrator", 20),
    }
    recording = flown(tmp_path, components, ["slow.y -> fast.u", "slow.y -> sum.u"], duration_s=2)
    assert_signal(recording, "slow.y", lambda ms: ms // 500)
    assert_signal(recording, "fast.y", lambda ms: max(ms - 50, 0) // 500)
    x, total = 1.0, {}
    for ms in range(0, 2001, 50):
        total[ms] = x
        x += 0.05 * (ms // 500)
    assert_signal(recording, "sum.y", total.__getitem__)


def test_the_order_in_the_file_does_not_matter(part, tmp_path):
    """Fast before slow gives the same as slow before fast."""
    pair = {"slow": part("decay", 2), "fast": part("integrator", 20)}
    recordings = []
    for name, names in (("a", ["slow", "fast"]), ("b", ["fast", "slow"])):
        folder = tmp_path / name
        folder.mkdir()
        wires = ["slow.y -> fast.u", "fast.y -> slow.u"]
        recordings.append(flown(folder, {n: pair[n] for n in names}, wires))
    for name in ("slow.y", "fast.y"):
        np.testing.assert_array_equal(recordings[0][name][1], recordings[1][name][1])


def test_decay_is_the_power_of_its_own_step(part, tmp_path):
    """100 internal steps of 10 ms a second, however they are cut: y = 0.99^(100 t)."""
    rates = {"c1": 1, "c4": 4, "c20": 20}
    components = {name: part("decay", rate) for name, rate in rates.items()}
    recording = flown(tmp_path, components, duration_s=2)
    for name in rates:
        times, values = recording[f"{name}.y"]
        np.testing.assert_allclose(values, 0.99 ** np.round(100 * times), rtol=1e-13)


def test_two_integrators_drive_each_other(part, tmp_path):
    """Jacobi: both read the other's value at the beginning of the step, so y = 1.1^n, twice."""
    components = {"a": part("integrator", 10), "b": part("integrator", 10)}
    recording = flown(tmp_path, components, ["a.y -> b.u", "b.y -> a.u"])
    x, expected = 1.0, {}
    for n in range(11):
        expected[100 * n] = x
        x += 0.1 * x
    assert_signal(recording, "a.y", expected.__getitem__)
    assert_signal(recording, "b.y", expected.__getitem__)
    assert expected[1000] == pytest.approx(1.1**10)


def test_three_rates_in_a_ring(part, tmp_path):
    """2, 10 and 20 Hz: each holds what its source last published at or before its own step."""
    rates = {"a": 2, "b": 10, "c": 20}
    components = {name: part("integrator", rate) for name, rate in rates.items()}
    recording = flown(tmp_path, components, ["a.y -> b.u", "b.y -> c.u", "c.y -> a.u"])
    x = dict.fromkeys(rates, 1.0)
    running = {}
    expected = {name: {0: 1.0} for name in rates}
    for ms in range(0, 1001, 50):
        for name, rate in rates.items():
            if ms and ms % (1000 // rate) == 0:
                x[name] += running[name] * (1 / rate)
                expected[name][ms] = x[name]
        for name, source in (("a", "c"), ("b", "a"), ("c", "b")):
            if ms % (1000 // rates[name]) == 0:
                running[name] = x[source]
    for name in rates:
        assert_signal(recording, f"{name}.y", expected[name].__getitem__)


def test_a_delayed_connection_is_late_by_its_delay(part, tmp_path):
    """The relay alone is one step late; delay_s adds to it, and before that the start value holds."""
    components = {"slow": part("staircase", 10, PERIOD=0.1), "fast": part("relay", 20)}
    wires = [{"from": "slow.y", "to": "fast.u", "delay_s": 0.15}]
    recording = flown(tmp_path, components, wires)
    assert_signal(recording, "fast.y", lambda ms: max(ms - 200, 0) // 100)


def test_sampled_feedthrough_is_of_the_same_instant(part, tmp_path):
    """A sampled chain passes on at once, in the order that ModelStructure demands."""
    sampled = {"fmu": {"kind": "sampled"}}
    components = {  # the wrong order on purpose
        "last": part("feedthrough", 10, sampled),
        "first": part("feedthrough", 10, sampled),
        "source": part("integrator", 10),
        "again": part("integrator", 10),
    }
    wires = [
        "source.y -> first.Float64_in",
        "first.Float64_out -> last.Float64_in",
        "last.Float64_out -> again.u",
        "again.y -> source.u",
    ]
    recording = flown(tmp_path, components, wires)
    source = dict(zip(*(recording["source.y"]), strict=True))
    for name in ("first", "last"):
        for time, value in zip(*recording[f"{name}.Float64_out"], strict=True):
            assert value == source[time]
    x = 1.0
    for _ in range(10):
        x += 0.1 * x
    assert recording["again.y"][1][-1] == recording["source.y"][1][-1] == x


def test_continuous_feedthrough_is_of_the_same_instant(part, tmp_path):
    """Outputs that pass inputs on are read after their source, whatever the kind."""
    components = {"pass": part("feedthrough", 10), "source": part("integrator", 10)}
    wires = ["source.y -> pass.Float64_in", "pass.Float64_out -> source.u"]
    recording = flown(tmp_path, components, wires)
    np.testing.assert_array_equal(recording["pass.Float64_out"][1], recording["source.y"][1])
    assert recording["source.y"][1][-1] == pytest.approx(1.1**10)


def test_a_latency_releases_outputs_later(part, tmp_path):
    """A sampled staircase of 2 Hz with 0.2 s of latency: its n-th value is seen from 0.2 s on."""
    more = {"fmu": {"kind": "sampled"}, "latency_s": 0.2}
    components = {"slow": part("staircase", 2, more, PERIOD=0.5), "fast": part("relay", 20)}
    recording = flown(tmp_path, components, ["slow.y -> fast.u"], duration_s=2)
    times, values = recording["slow.y"]
    np.testing.assert_allclose(times, [0.0, 0.2, 0.7, 1.2, 1.7])
    np.testing.assert_array_equal(values, [0, 1, 2, 3, 4])
    assert_signal(recording, "fast.y", lambda ms: (ms - 50 - 200) // 500 + 1 if ms >= 250 else 0)


@pytest.mark.parametrize("rate", [2, 20])
def test_time_events_inside_a_step_are_met(part, fmi, rate, tmp_path):
    """Events every 0.12 s come neither early nor late, in event mode (FMI 3) or without (FMI 2)."""
    recording = flown(tmp_path, {"a": part("staircase", rate, PERIOD=0.12)}, duration_s=3)
    assert_signal(recording, "a.count", lambda ms: ms // 120)
    assert kinds(recording) == []
    calls = recording["a.calls"][1][-1]
    assert calls == 3 * rate if fmi == 2 else calls > 3 * rate


def test_libraries_with_the_same_symbols_do_not_mix(part, fmi, tmp_path):
    """Same file name, model identifier, and global names; another number inside."""
    components = {
        "source": part("staircase", 10, PERIOD=0.1),
        "two": part("relay", 10, SCALE=2),
        "three": part("relay", 10, SCALE=3),
        "two_again": part("relay", 10, SCALE=2),
    }
    assert components["two"]["use"].name == components["three"]["use"].name
    wires = ["source.y -> two.u", "source.y -> three.u", "two.y -> two_again.u"]
    recording = flown(tmp_path, components, wires)
    assert_signal(recording, "two.y", lambda ms: 2 * max(ms // 100 - 1, 0))
    assert_signal(recording, "three.y", lambda ms: 3 * max(ms // 100 - 1, 0))
    assert_signal(recording, "two_again.y", lambda ms: 4 * max(ms // 100 - 2, 0))


def test_everything_passes_through(part, fmi, tmp_path):
    """Every scalar type, arrays and texts come out as they went in, at the same instant."""
    arrays = {"fmu": {"arrays": True, "kind": "sampled"}}
    given = {
        "Float64_in": 0.1,
        "Int32_in": -(2**31),
        "Boolean_in": True,
        "String_in": "Höhe 10 m, 100%",
        "Enumeration_in": 2,
        "vector_in": [1.0, -2.0, 1e300],
        "matrix_in": [[1.0, 2.0], [3.0, 4.0]],
    }
    if fmi == 3:
        given |= {
            "Float32_in": 0.5, "Int8_in": -128, "UInt8_in": 255, "Int16_in": -(2**15),
            "UInt16_in": 2**16 - 1, "UInt32_in": 2**32 - 1, "Int64_in": -(2**63),
            "UInt64_in": 2**63 - 1, "integers_in": [1, -1], "flags_in": [True, False],
        }  # fmt: skip
    one = part("feedthrough", 10, {"parameters": given, **arrays})
    two = part("feedthrough", 10, arrays)
    wires = [f"one.{name.replace('_in', '_out')} -> two.{name}" for name in given]
    if fmi == 3:
        wires += ["one.Binary_out -> two.Binary_in", "one.words_out -> two.words_in"]
    recording = flown(tmp_path, {"one": one, "two": two}, wires, duration_s=0.2)
    for name, value in given.items():
        out = recording["two." + name.replace("_in", "_out")][1]
        np.testing.assert_array_equal(out[-1], value, err_msg=name)
    if fmi == 3:
        assert recording["two.Binary_out"][1][-1] == b"\x00\xff"
        assert list(recording["two.words_out"][1][-1]) == ["none", "none"]


def test_start_values_and_tunable_parameters_are_taken_over(part, tmp_path):
    """A state starts where the scenario says; a tunable parameter changes at its time."""
    one = part("decay", 10, {"parameters": {"x": 8.0, "k": 0.0}})
    events = [{"at_s": 0.5, "set": "a.k", "value": -2.0}, {"at_s": 0.5, "set": "a.u", "value": 1.0}]
    recording = flown(tmp_path, {"a": one}, events=events)
    x, expected = 8.0, {}
    for n in range(101):
        if n % 10 == 0:
            expected[10 * n] = x
        if n >= 50:
            x += 0.01 * (-2.0 * x + 1.0)
    _times, values = recording["a.y"]
    np.testing.assert_allclose(values, list(expected.values()), rtol=1e-13)


def test_a_folder_does_for_an_archive(part, tmp_path):
    """An unpacked FMU flies like the file."""
    keys = part("relay", 10)
    folder = tmp_path / "relay"
    with zipfile.ZipFile(keys["use"]) as archive:
        archive.extractall(folder)
    for place, use in (("file", keys["use"]), ("folder", folder)):
        (tmp_path / place).mkdir()
        components = {"source": part("staircase", 10, PERIOD=0.1), "a": {**keys, "use": use}}
        recording = flown(tmp_path / place, components, ["source.y -> a.u"])
        assert_signal(recording, "a.y", lambda ms: max(ms // 100 - 1, 0))
    assert sorted(p.name for p in folder.iterdir()) == ["binaries", "modelDescription.xml"]


def test_two_flights_are_the_same_to_the_last_byte(part, tmp_path):
    """As for native components: same scenario, same recording."""
    components = {"a": part("decay", 20), "b": part("staircase", 2, PERIOD=0.12)}
    files = []
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        flown(tmp_path / name, components, ["b.y -> a.u"])
        files.append(tmp_path / name / "flight.mcap")
    assert files[0].read_bytes() == files[1].read_bytes()
    assert diff(*files) == []
