"""Talk to a terminal: tables, a progress bar, Ctrl-C."""

import signal
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table


def print_table(title: str, table: Table) -> None:
    """Print to stdout, as wide as the terminal; wide enough for whole lines elsewhere."""
    console = Console(highlight=False, markup=False, width=None if sys.stdout.isatty() else 160)
    console.print(title, style="bold", markup=False)
    console.print(table)


def announce(name: str) -> None:
    """Tell a terminal that something takes a while to make."""
    if sys.stderr.isatty():
        print(f"preparing {name} ...", file=sys.stderr)


def agreed(what: str) -> bool:
    """Ask on the terminal whether to go on; without a terminal the answer is no."""
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        return False
    print(f"{what}. Go on? [y/N] ", end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip().lower() in ("y", "yes")


@contextmanager
def progress_bar(end_ns: int) -> Generator[Callable[[int], None] | None]:
    """Show how much has been flown, on stderr, if that is a terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.0f} of {task.total:.0f} s"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("flying", total=end_ns / 1e9)
        yield lambda time_ns: bar.update(task, completed=time_ns / 1e9)


@contextmanager
def status_line() -> Generator[Callable[[str], None] | None]:
    """Show one line that changes, on stderr, if that is a terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    with Console(stderr=True).status("") as status:
        yield status.update


@contextmanager
def signals() -> Generator[list[int]]:
    """Collect SIGINT and SIGTERM instead of dying of them; the second of a kind does its work."""
    caught: list[int] = []
    before = [(number, signal.getsignal(number)) for number in (signal.SIGINT, signal.SIGTERM)]

    def note(number: int, _: object) -> None:
        caught.append(number)
        signal.signal(number, dict(before)[signal.Signals(number)])

    for number, _ in before:
        signal.signal(number, note)
    try:
        yield caught
    finally:
        for number, handler in before:
            signal.signal(number, handler)
