"""The command-line program: `lightpath` and `python -m lightpath`."""

import os
import signal
import sys
import sysconfig

from ._lightpath import main as _main


def main():
    """Run the program with the arguments of the process, and exit with its code."""
    # The program handles signals itself; Python's handler would wait for it. A job in the background
    # ignores Ctrl-C.
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    program = os.path.abspath(sys.argv[0])
    if program == os.path.abspath(__file__):  # python -m lightpath
        program = os.path.join(sysconfig.get_path("scripts"), "lightpath")
    sys.exit(_main(["lightpath", *sys.argv[1:]], program))


if __name__ == "__main__":
    main()
