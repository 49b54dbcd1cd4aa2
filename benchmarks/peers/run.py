"""Give one optimal control problem to Hedgehop and to its peers, and print a table.

Terrain following for 10 s at 30 m/s (H = 200) on the traced R-50 in attitude form, from trim on the
course and 25 m beside and 8 m below it. CPU time of one thread. *cold*: from trim commands to the
solver's own end; *warm*: once more from its own answer, which for Hedgehop and for acados is one pass,
as in a controller. J* is the least cost that anyone found; every J is that of our compiled rollouts.
"""

import argparse
import json
import sys
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from time import process_time

sys.path.insert(0, str(Path(__file__).parents[1]))
import machine  # sets the threads, before numpy
from problems import OFFSETS, cost, miss, start

MODULES = ("with_hedgehop", "with_do_mpc", "with_acados")


def timed(solve, *arguments):
    """Return CPU seconds and the answer."""
    began = process_time()
    answer = solve(*arguments)
    return process_time() - began, answer


def measure(peer, horizon):
    """Return the figures of a peer from every start, as plain data."""
    problems = {name: start(name, horizon) for name in OFFSETS}
    build, solve = timed(peer.prepare, problems["on course"])
    rows = []
    for name, problem in problems.items():
        cold, answer = timed(solve, problem, problem.u0, False)
        warm, again = timed(solve, problem, answer.u, True)
        J = cost(problem, answer.u)
        east, up = miss(problem, answer.u)
        rows.append({
            "peer": peer.name, "start": name, "build_s": build, "cold_s": cold, "warm_s": warm,
            "iterations": answer.iterations, "warm_iterations": again.iterations,
            "status": answer.status, "J": J, "J_again": cost(problem, again.u),
            "east_m": east, "up_m": up,
        })  # fmt: skip
    return rows


def versions(peers):
    """Return the versions of the packages that ran, as one line."""
    found = {}
    for name in dict.fromkeys(package for peer in peers for package in peer.packages):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "?"
    return ", ".join(f"{name} {number}" for name, number in found.items())


def table(rows):
    """Return the figures as a Markdown table, J over the least of each start."""
    least = {name: min(r["J"] for r in rows if r["start"] == name) for name in OFFSETS}
    lines = [
        "| solver | start | build s | cold s | passes | warm s | passes | J/J* - 1 | end m | outcome |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for r in rows:
        excess = f"{100 * (r['J'] / least[r['start']] - 1):.2f} %"
        lines.append(
            f"| {r['peer']} | {r['start']} | {r['build_s']:.1f} | {r['cold_s']:.3g} "
            f"| {r['iterations']} | {r['warm_s']:.3g} | {r['warm_iterations']} | {excess} "
            f"| {r['east_m']:.2f} / {r['up_m']:.2f} | {r['status']} |"
        )
    stars = ", ".join(f"{name} {J:.4f}" for name, J in least.items())
    return "\n".join([*lines, "", f"J*: {stars}."])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--horizon", type=int, default=200, help="samples of 50 ms (200)")
    parser.add_argument("--only", help="peers whose name contains this")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here too")
    arguments = parser.parse_args()
    print(machine.line(), flush=True)
    peers = [peer for module in MODULES for peer in import_module(module).PEERS]
    rows, ran = [], []
    for peer in peers:
        if arguments.only and arguments.only.lower() not in peer.name.lower():
            continue
        try:
            found = measure(peer, arguments.horizon)
        except ImportError as error:
            print(f"{peer.name}: not installed ({error.name}), not run", flush=True)
            continue
        rows += found
        ran.append(peer)
        print(f"{peer.name}: " + ", ".join(f"J {r['J']:.4f}" for r in found), flush=True)
    if rows:
        print("", versions(ran), "", table(rows), sep="\n")
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=2) + "\n")


if __name__ == "__main__":
    main()
