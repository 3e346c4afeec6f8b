"""Figures of the watch: false alarms over a year of sessions, and how soon steps and ramps are told.

    python -m benchmarks.watch record FOLDER --simulator kinematic --number 900
    python -m benchmarks.watch resample FOLDER

`record` simulates sessions of one machine, learns from ten of them, and keeps the statistics of all in
`FOLDER/<simulator>_<number>.npz`. `resample` draws machines' years from these with replacement, as recording each year
would take days: nominal sessions and later ones come from one pool, so that tails beyond the pool are not tried. A
ramp is the step's mean change in growing shares, on top of a sound session. A repair ends ten sessions of a step.
"""

import argparse
from pathlib import Path

from benchmarks.closed_loop.simulators import SIMULATORS
from benchmarks.watch.sessions import record
from benchmarks.watch.years import COLUMNS, resample


def main() -> None:
    parser = argparse.ArgumentParser(prog="watch", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("what", choices=("record", "resample"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--simulator", choices=SIMULATORS, default="kinematic")
    parser.add_argument("--number", type=int, default=900, help="of the machine")
    arguments = parser.parse_args()
    if arguments.what == "record":
        record(arguments.folder, arguments.simulator, arguments.number)
        return
    print(f"| {' | '.join(COLUMNS)} |")
    print("|---" * len(COLUMNS) + "|")
    for path in sorted(arguments.folder.glob("*.npz")):
        resample(path)


if __name__ == "__main__":
    main()
