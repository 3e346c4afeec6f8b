"""A worker process of `test_study.py`: a cheap objective that takes time, and a log of what was evaluated."""

import os
import sys
import time

from pipeline.dynamics.search.search_space import Choose
from pipeline.study.settings import Pruner, SamplerKind, StudySettings
from pipeline.study.worker import DivergedError, RunningTrial, Study

OPTIONS = [0, 1, 2, 3, 4, 5, 6, 7]
EPOCHS = 5


def settings(**changes) -> StudySettings:
    values = {
        "seed": 3,
        "sampler": SamplerKind.tpe,
        "startup_trials": 4,
        "pruner": Pruner.none,
        "pruner_warmup_epochs": 1,
        "heartbeat_s": 0.2,
        "stale_after_s": 1.0,
        "maximum_attempts": 5,
    }
    return StudySettings(**(values | changes))


def propose(choose: Choose) -> tuple[int, int]:
    return choose("x", OPTIONS), choose("y", OPTIONS)


def value(x: int, y: int) -> float:
    return (x - 2) ** 2 + 0.5 * (y - 5) ** 2


def main(storage: str, n_trials: int, epoch_s: float, log: str) -> None:
    def evaluate(proposal: tuple[int, int], trial: RunningTrial) -> tuple[float, dict]:
        note(log, f"start {trial.number} {os.getpid()}")
        for epoch in range(1, EPOCHS + 1):
            time.sleep(epoch_s)
            trial.report(epoch, value(*proposal) + 1.0 / epoch)
        if proposal[0] == OPTIONS[-1]:
            raise DivergedError("too far")
        note(log, f"end {trial.number} {os.getpid()}")
        return value(*proposal), {"sum": sum(proposal)}

    Study(storage, "study", settings(), EPOCHS).run(n_trials, propose, evaluate)


def note(log: str, line: str) -> None:
    with open(log, "a") as file:
        file.write(f"{line}\n")


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), float(sys.argv[3]), sys.argv[4])
