"""The table of controllers by courses: resumable, ordered, and honest about what is missing."""

import pytest

from paper.flights import (
    CONTROLLERS,
    COURSES,
    FIGURES,
    Controller,
    fly_course,
    fly_missing,
    main,
    markdown,
    read_rows,
    write_rows,
)

TENTS = next(each for each in CONTROLLERS if each.name == "10 tents")
SHORT = ["duration_s=3"]


def row(controller, course, **figures):
    """Return a kept row; figures that are not given are empty."""
    known = dict.fromkeys(FIGURES, "") | {"outcome": "flown", "duration_s": "60"}
    return {"controller": controller, "course": course, **known, **figures}


def test_a_controller_is_overrides_of_a_scenario():
    """One line names what flies, others its parameters."""
    assert Controller("x", "a.b:C", {"n": 3}).overrides() == [
        "components.mpc.use=a.b:C",
        "components.mpc.parameters.n=3",
    ]


def test_a_flight_leaves_its_figures():
    """Three seconds over the ridges: flown, and every figure is there."""
    found = fly_course(TENTS, "ridges", SHORT)
    assert (found["controller"], found["course"], found["outcome"]) == (
        "10 tents",
        "ridges",
        "flown",
    )
    assert float(found["clearance_min_m"]) > 9.0
    assert set(FIGURES) <= set(found)


def test_what_is_there_is_not_flown_again(tmp_path):
    """Only missing flights are flown, and each is kept at once."""
    file, told = tmp_path / "deep" / "rows.csv", []
    write_rows([row("10 tents", "ridges", height_rms_m="1.5")], file)
    rows = fly_missing(file, [TENTS], ["ridges", "fractal"], told.append, overrides=SHORT)
    assert [line.split(":")[0] for line in told] == ["10 tents, fractal"]
    assert [each["course"] for each in rows] == ["ridges", "fractal"]
    assert rows[0]["height_rms_m"] == "1.5"
    assert rows == read_rows(file)


def test_again_flies_anew(tmp_path):
    """Asked for again, a kept flight is replaced."""
    file, told = tmp_path / "rows.csv", []
    write_rows([row("10 tents", "ridges", height_rms_m="1.5")], file)
    rows = fly_missing(file, [TENTS], ["ridges"], told.append, again=True, overrides=SHORT)
    assert len(rows) == len(told) == 1
    assert float(rows[0]["height_rms_m"]) < 1.0


def test_a_controller_that_does_not_exist_is_left_out_and_told(tmp_path):
    """No row, no traceback, one line that names it and why."""
    told = []
    unknown = Controller("of tomorrow", "controller.tomorrow:Mpc", {})
    assert fly_missing(tmp_path / "rows.csv", [unknown], COURSES, told.append) == []
    (line,) = told
    assert line.startswith("of tomorrow: left out, ")
    assert "controller.tomorrow" in line


def test_the_table_has_a_line_per_controller_and_a_column_per_course():
    """Figures of flights to the end, outcome and time of lost ones, nothing for what is missing."""
    rows = [
        row("10 tents", "ridges", height_rms_m="0.0123", clearance_min_m="9.5",
            cpu_ms_per_simulated_s="30.4"),
        row("10 tents", "fractal", outcome="left_terrain", duration_s="12.4"),
    ]  # fmt: skip
    lines = markdown(rows).splitlines()
    assert lines[0] == "| controller | jacksboro | volcano | ridges | fractal |"
    assert lines[2:] == ["| 10 tents |  |  | 0.012 / 9.50 / 30 | left terrain, 12 s |"]


def test_rows_are_kept_in_the_order_of_the_table(tmp_path):
    """Whatever order they were flown in; rows of controllers unknown by now are dropped."""
    file = tmp_path / "rows.csv"
    write_rows(
        [row("nonlinear", "volcano"), row("gone", "ridges"), row("10 tents", "fractal")], file
    )
    assert [each["controller"] for each in read_rows(file)] == ["10 tents", "nonlinear"]


def test_the_command_prints_markdown(tmp_path, capsys):
    """What is kept is printed; an unknown controller is refused."""
    file = tmp_path / "rows.csv"
    write_rows([row("10 tents", "ridges", outcome="collision", duration_s="3")], file)
    main(["--rows", str(file), "--controller", "10 tents", "--course", "ridges"])
    assert "| 10 tents |  |  | collision, 3 s |  |" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["--controller", "11 tents"])
