"""Run every benchmark but the study of random starts, and print the figures beside their targets.

Nothing fails here: the speed of a shared machine varies by half. A flight is therefore judged twice, by
its median and by the least of every stretch, which falls with the number of repetitions; the floor of
an update, measured in the same minute, tells how fast the machine was.
"""

import argparse
import json
from pathlib import Path

import flight
import machine
import mpc_update
import orchestrator_overhead as overhead

OVERHEAD_TARGET = 5.0  # us per plant step
STATES = 17


def overhead_us():
    """Return what the orchestrator adds to a plant step without listeners, us."""
    alone = min(overhead.bare(STATES) for _ in range(overhead.REPETITIONS))
    whole = min(overhead.coupled(STATES, is_traced=False) for _ in range(overhead.REPETITIONS))
    return 1e6 * (whole - alone) / (20 * overhead.SECONDS)


def measure(repetitions):
    """Return all figures as plain data."""
    return {
        "machine": machine.describe(),
        "update_ms": {case: mpc_update.measure(case, repetitions) for case in mpc_update.CASES},
        "flight_ms_per_s": {case: flight.measure(case, repetitions) for case in flight.CASES},
        "overhead_us_per_step": overhead_us(),
    }


def rows(found):
    """Yield (quantity, figure, target or nothing) of the closing table."""
    for case, update in found["update_ms"].items():
        yield f"MPC update, {case}, ms (median)", update["median"]["whole update"], None
        yield f"  lane kernel alone: the floor, {case}, ms", update["median"]["floor"], None
    for case, whole in found["flight_ms_per_s"].items():
        for statistic in ("median", "least"):
            name = f"whole run, {case}, ms per simulated s ({statistic})"
            yield name, whole[statistic], whole["target"]
    yield "orchestrator per plant step, us", found["overhead_us_per_step"], OVERHEAD_TARGET


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repetitions", type=int, default=4, help="flights per figure (4)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here too")
    arguments = parser.parse_args()
    print(machine.line(), flush=True)
    found = measure(arguments.repetitions)
    print(
        "\nCPU ms per update of the MPC",
        mpc_update.table(found["update_ms"]),
        "\nCPU ms per simulated second, with recording",
        flight.table(found["flight_ms_per_s"]),
        "",
        sep="\n",
    )
    for quantity, figure, target in rows(found):
        met = "" if target is None else "met" if figure <= target else "NOT MET"
        bound = "" if target is None else f"{target:.0f}"
        print(f"{quantity:52}{figure:8.2f}{bound:>8}  {met}".rstrip())
    if arguments.json:
        arguments.json.write_text(json.dumps(found, indent=2) + "\n")


if __name__ == "__main__":
    main()
