"""The command line: ``hedgehop``, or ``python -m orchestrator``; the commands are in ``command/``."""

import os
import signal
import sys

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


def main() -> None:
    """Run the command line and leave with its exit code."""
    for name in THREADS:  # before numpy is imported: more threads make a small problem slower
        os.environ[name] = "1"
    signal.signal(signal.SIGINT, signal.default_int_handler)  # shells hide it from background jobs
    try:
        from orchestrator.command.app import status

        code = status(sys.argv[1:])
    except KeyboardInterrupt:  # as early as that
        print("interrupted", file=sys.stderr)
        code = 130
    sys.exit(code)


if __name__ == "__main__":
    main()
