"""Pass on what components log, with the simulated time, while a run lasts."""

import logging
from collections.abc import Generator
from contextlib import contextmanager

from orchestrator.run.report import LOGGER, Report


class Journal(logging.Handler):
    """Keeps records until :meth:`tell`: they may come from any thread, listeners have one."""

    def __init__(self, report: Report) -> None:
        super().__init__()
        self.records = report.logged
        self._report = report

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a record and when it was made."""
        self.records.append((self._report.time_ns, record))

    def tell(self) -> None:
        """Pass on what has come, in order."""
        while self.records:
            time_ns, record = self.records.popleft()
            name = record.name.removeprefix(LOGGER + ".")
            for listener in self._report.listeners:
                listener.log(time_ns, record.levelno, name, record.getMessage())


@contextmanager
def journal(report: Report) -> Generator[Journal]:
    """Keep everything that components log, of whatever level.

    What is left at the end, because no listener was opened, goes where Python's log goes.
    """
    logger = logging.getLogger(LOGGER)
    made, level = Journal(report), logger.level
    logger.addHandler(made)
    logger.setLevel(logging.DEBUG)
    try:
        yield made
    finally:
        logger.removeHandler(made)
        logger.setLevel(level)
        last = None if logger.hasHandlers() else logging.lastResort
        for _, record in made.records:
            if last is not None and record.levelno >= last.level:
                last.handle(record)
