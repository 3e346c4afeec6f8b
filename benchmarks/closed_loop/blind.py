"""Become another program that cannot read a folder.

    python blind.py FOLDER COMMAND …

The superuser's right to pass over permissions is given up for good before the command takes this process's place.
Runs by itself, whatever the working folder, so that nothing of the benchmark need be importable there.
"""

import ctypes
import os
import sys

PR_CAPBSET_DROP = 24  # linux/prctl.h
CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH = 1, 2  # linux/capability.h
PR_SET_NO_NEW_PRIVS = 38
PROBE = "import os, sys\ntry: os.listdir(sys.argv[1])\nexcept PermissionError: sys.exit(0)\nsys.exit(1)"
STILL_READABLE = 3


def give_up_override() -> None:
    """Take the capabilities from the bounding set: the next program that is executed does not get them."""
    if os.geteuid() != 0:
        return
    library = ctypes.CDLL(None, use_errno=True)
    for capability in (CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH):
        if library.prctl(PR_CAPBSET_DROP, capability, 0, 0, 0) != 0:
            raise OSError(ctypes.get_errno(), "cannot give up the right to pass over permissions")
    library.prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0)


def main() -> None:
    folder, *command = sys.argv[1:]
    give_up_override()
    if os.spawnv(os.P_WAIT, sys.executable, [sys.executable, "-c", PROBE, folder]) != 0:
        print(f"error: {folder} can be read; nothing was started", file=sys.stderr)
        sys.exit(STILL_READABLE)
    os.execvp(command[0], command)


if __name__ == "__main__":
    main()
