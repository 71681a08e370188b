"""The command line: `python -m drystone`, and the command `drystone`."""

import signal
import sys


def main() -> None:
    """Runs the program with the arguments of this process, and exits with its code."""
    # The program has its own handling of signals.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    from drystone import _native

    if sys.stdout is not None:
        sys.stdout.flush()
    sys.exit(_native.main(["drystone", *sys.argv[1:]]))


if __name__ == "__main__":
    main()
