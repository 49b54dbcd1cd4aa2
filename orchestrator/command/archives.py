"""Commands that exchange scenarios with other masters."""

import sys
from pathlib import Path

from orchestrator.command.arguments import Out, Overrides, user_errors


def export_ssp(
    scenario: Path,
    /,
    *,
    out: Out,
    overrides: Overrides = None,
) -> None:
    """Write a scenario as an SSP 1.0 archive, its components as FMUs, for other masters.

    Parameters
    ----------
    scenario
        The scenario's YAML file.
    out
        The archive to write, ending in .ssp.
    overrides
        A value to change, as components.mpc.parameters.basis=tent; may be repeated.
    """
    from orchestrator.exchange.ssp import export_ssp as write

    with user_errors():
        for line in write(scenario, out, overrides or ()):
            print(f"note: {line}", file=sys.stderr)
    print(f"{out}: written")


def import_ssp(
    archive: Path,
    /,
    *,
    out: Out,
    duration_s: float | None = None,
) -> None:
    """Unpack an SSP 1.0 archive and write the scenario that runs it; nothing is run.

    Parameters
    ----------
    archive
        The .ssp file.
    out
        The folder to write to.
    duration_s
        Simulated time, where the archive says none or another is wanted.
    """
    from orchestrator.exchange.ssp import import_ssp as read

    with user_errors():
        print(f"{read(archive, out, duration_s)}: written")
