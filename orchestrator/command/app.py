"""The commands of ``hedgehop``.

Exit codes: 0 flown (or same, or valid); 1 the flight failed (or files differ); 2 bad usage or bad
scenario; 3 a defect; 130 interrupted, 143 terminated.
"""

import os
import sys
import traceback
from collections.abc import Sequence
from importlib.metadata import entry_points, version

from cyclopts import App, CycloptsError

from orchestrator.command import archives, components, flights, recordings
from orchestrator.errors import ScenarioError

# heavy imports happen inside the commands: `hedgehop --help` must answer at once

GROUP = "hedgehop.commands"
"""Packages add commands by entry points in this group."""
COMMANDS = (
    flights.run, flights.validate, flights.replay,
    components.list_, components.inspect, components.check, components.export, components.schema,
    recordings.info, recordings.metrics, recordings.diff, recordings.report, recordings.view,
    recordings.layout, recordings.convert, recordings.recover,
    archives.export_ssp, archives.import_ssp,
)  # fmt: skip

app = App(
    name="hedgehop",
    help="Fly helicopters nap-of-the-earth: couple components by co-simulation and record them.",
    help_format="plaintext",
    version=lambda: version("hedgehop"),
    print_error=False,
    exit_on_error=False,
    result_action="return_value",
    suppress_keyboard_interrupt=False,
)

for _command in COMMANDS:
    app.command(_command)
for _point in sorted(entry_points(group=GROUP)):
    try:
        app.command(_point.load(), name=_point.name)
    except Exception as error:  # noqa: BLE001  (of another package: the others go on)
        print(f"hedgehop {_point.name}: {_point.value} is broken, {error}", file=sys.stderr)


def status(tokens: Sequence[str]) -> int:
    """Return the exit code of a command; errors become a line on stderr."""
    try:
        code = app(tokens)
        sys.stdout.flush()
    except CycloptsError as error:
        print(f"hedgehop: {error}", file=sys.stderr)
        return 2
    except ScenarioError as error:
        _explain(error)
        return 2
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:  # as by `hedgehop list | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except Exception as error:  # noqa: BLE001  the last resort
        notes = "".join(f", {note}" for note in getattr(error, "__notes__", ()))
        print(f"hedgehop: internal error, {type(error).__name__}: {error}{notes}", file=sys.stderr)
        if os.environ.get("HEDGEHOP_TRACEBACK") != "1":
            print("set HEDGEHOP_TRACEBACK=1 to see where", file=sys.stderr)
        else:
            traceback.print_exc()
        return 3
    return code or 0


def _explain(error: ScenarioError) -> None:
    print(error, file=sys.stderr)
    if len(error.problems) > 1:
        print(f"{len(error.problems)} problems", file=sys.stderr)
    if os.environ.get("HEDGEHOP_TRACEBACK") == "1":
        traceback.print_exc()
