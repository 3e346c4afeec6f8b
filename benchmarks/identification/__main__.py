"""Identify kinds of models from logs of machines that none was tuned on, and compare them.

    python -m benchmarks.identification machines ROOT --plant 9001 9002 --kinematic 9001 9002 --minutes 24 --seeds 0 1 2
        --kinds mlp_dqdot arx grey_box [--gp-python PATH]
    python -m benchmarks.identification logs ROOT --machine rc_excavator --logs FOLDER --kinds mlp_dqdot arx
    python -m benchmarks.identification score LEDGER --markdown TABLE --plot PICTURE

A kind may have other settings than the profile's: `mlp_dqdot:horizon=32:maximum_epochs=20`.
Each fitted model is one line of `ROOT/ledger.jsonl`. What is there is not done again, unless `--again` is given.
"""

import argparse
import itertools
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from benchmarks.closed_loop.sessions import machine as drawn_machine
from benchmarks.identification import ledger
from benchmarks.identification.gaussian_process import GaussianProcess
from benchmarks.identification.kinds import Fit, fits_of
from benchmarks.identification.ledger import Row
from benchmarks.identification.measure import coverage, errors
from benchmarks.identification.recordings import recordings
from benchmarks.identification.score import write_score
from pipeline.configuration.from_python import read_logs
from pipeline.configuration.load import load_machine
from pipeline.errors import InputError
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import MachineSpecification


def fitted(
    name: str,
    minutes: float,
    seed: int,
    kind: str,
    fit: Fit,
    machine: MachineSpecification,
    learning: Sequence[Trajectory],
    held_out: Sequence[Trajectory],
) -> Row:
    """Fit a kind and measure it."""
    begin = time.process_time()
    predictor = fit(learning, machine, seed)
    seconds = time.process_time() - begin
    if isinstance(predictor, GaussianProcess):
        seconds += predictor.processor_s
    try:
        found = Row(
            name,
            minutes,
            seed,
            kind,
            errors(predictor, held_out),
            coverage(predictor, held_out),
            seconds,
        )
    finally:
        if isinstance(predictor, GaussianProcess):
            predictor.close()
    return found


def run_machines(arguments: argparse.Namespace, kinds: dict[str, Fit]) -> None:
    """Fit all kinds that are asked for, on all drawn machines."""
    machine = drawn_machine()
    numbers = [("plant", n) for n in arguments.plant] + [("kinematic", n) for n in arguments.kinematic]
    for (simulator, number), minutes in itertools.product(numbers, arguments.minutes):
        name = f"{simulator}_{number}"
        wanted = list(itertools.product(arguments.seeds, arguments.kinds))
        missing = _missing(arguments, [(name, minutes, seed, kind) for seed, kind in wanted])
        if not missing:
            continue
        logs = recordings(arguments.root, simulator, number, minutes)
        floor = {str(horizon): values.tolist() for horizon, values in logs.floor.items()}
        if _missing(arguments, [(name, 0.0, 0, "floor")]):
            ledger.add(_ledger(arguments), Row(name, 0.0, 0, "floor", floor))
        for _, _, seed, kind in missing:
            _add(
                arguments,
                fitted(name, minutes, seed, kind, kinds[kind], machine, logs.learning, logs.held_out),
            )


def run_logs(arguments: argparse.Namespace, kinds: dict[str, Fit]) -> None:
    """Hold out each log of a folder in turn."""
    machine = load_machine(arguments.machine)
    logs = read_logs(machine, arguments.logs)
    for name in dict.fromkeys(log.name.partition("#")[0] for log in logs):
        parts = [[t for t in logs if (t.name.partition("#")[0] == name) is held] for held in (False, True)]
        learning, held_out = parts
        minutes = round(sum(map(len, learning)) * machine.dt_s / 60.0, 1)
        place = f"{machine.name}/{name}"
        wanted = [(place, minutes, seed, kind) for seed in arguments.seeds for kind in arguments.kinds]
        for _, _, seed, kind in _missing(arguments, wanted):
            _add(arguments, fitted(place, minutes, seed, kind, kinds[kind], machine, learning, held_out))


def _missing(
    arguments: argparse.Namespace, keys: list[tuple[str, float, int, str]]
) -> list[tuple[str, float, int, str]]:
    present = ledger.read(_ledger(arguments))
    return [key for key in keys if arguments.again or key not in present]


def _add(arguments: argparse.Namespace, row: Row) -> None:
    ledger.add(_ledger(arguments), row)
    shown = " ".join(f"{1e3 * value:.1f}" for value in row.errors["80"])
    print(
        f"{row.machine} {row.minutes:g} min seed {row.seed} {row.kind}: 80 steps {shown} mrad or mm, "
        f"{row.training_s:.0f} s",
        file=sys.stderr,
        flush=True,
    )


def _ledger(arguments: argparse.Namespace) -> Path:
    path: Path = arguments.root / "ledger.jsonl"
    return path


def parse(words: Sequence[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="identification", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    common = argparse.ArgumentParser(add_help=False)
    common.add_argument("root", type=Path)
    common.add_argument("--kinds", nargs="+", required=True)
    common.add_argument("--seeds", nargs="+", type=int, default=[0])
    common.add_argument("--again", action="store_true", help="fit again what the ledger has")
    common.add_argument("--gp-python", help="a Python with GPJax, for the kind gaussian_process")
    machines = commands.add_parser("machines", parents=[common])
    machines.add_argument("--plant", nargs="*", type=int, default=[], metavar="NUMBER")
    machines.add_argument("--kinematic", nargs="*", type=int, default=[], metavar="NUMBER")
    machines.add_argument("--minutes", nargs="+", type=float, default=[24.0])
    logs = commands.add_parser("logs", parents=[common])
    logs.add_argument("--machine", required=True)
    logs.add_argument("--logs", type=Path, required=True)
    score = commands.add_parser("score")
    score.add_argument("ledger", type=Path)
    score.add_argument("--markdown", type=Path)
    score.add_argument("--plot", type=Path)
    return parser.parse_args(words)


def main() -> None:
    arguments = parse()
    try:
        if arguments.command == "score":
            write_score(ledger.read(arguments.ledger).values(), arguments.markdown, arguments.plot)
        else:
            run = run_machines if arguments.command == "machines" else run_logs
            run(arguments, fits_of(arguments.kinds, arguments.gp_python))
    except InputError as error:
        raise SystemExit(f"error: {error}") from error


if __name__ == "__main__":
    main()
