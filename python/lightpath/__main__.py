"""The command-line program: `lightpath` and `python -m lightpath`."""

import signal
import sys

from ._lightpath import main as _main


def main():
    """Run the program with the arguments of the process, and exit with its code."""
    # The program handles signals itself; Python's handler would wait for it.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.exit(_main(["lightpath", *sys.argv[1:]]))


if __name__ == "__main__":
    main()
