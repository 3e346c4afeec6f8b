"""A Gaussian process as a predictor of logs; it is fitted and evaluated in a process of another environment."""

import json
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from pipeline.errors import InputError
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import MachineSpecification

LAGS = 24  # rows of commands that it sees, the one about to act included


class GaussianProcess:
    """Predicts with the fit that the other process holds."""

    def __init__(
        self, python: str, learning: Sequence[Trajectory], machine: MachineSpecification, seed: int
    ) -> None:
        self._folder = tempfile.TemporaryDirectory()
        self._machine = machine
        script = Path(__file__).with_name("gaussian_process_gpjax.py")
        self._process = subprocess.Popen(
            [python, str(script)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        windows, places, speeds = zip(*(self._rows(trajectory) for trajectory in learning), strict=True)
        answer = self._ask(
            {"seed": seed},
            commands=np.concatenate(windows),
            place=np.concatenate(places),
            speed=np.concatenate(speeds),
        )
        self.processor_s = float(answer["processor_s"])

    @property
    def rows_before(self) -> int:
        """See `Predictor`."""
        return LAGS - 1

    def predict(self, trajectory: Trajectory, starts: np.ndarray, horizon: int) -> np.ndarray:
        """See `Predictor`."""
        rows = starts[:, None] + np.arange(1 - LAGS, horizon)
        lower = np.minimum(self._machine.lower, np.fmin.accumulate(trajectory.q)[starts])
        upper = np.maximum(self._machine.upper, np.fmax.accumulate(trajectory.q)[starts])
        answer = self._ask(
            {"dt_s": self._machine.dt_s},
            commands=trajectory.a[rows],
            q=trajectory.q[starts],
            lower=lower,
            upper=upper,
            scale=np.stack([self._machine.lower, self._machine.upper]),
        )
        predicted: np.ndarray = np.load(answer["file"])
        return predicted

    def _rows(self, trajectory: Trajectory) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Command windows (N, lags, n), positions in [-1, 1] (N, n) and speeds to the next row (N, n)."""
        rows = np.flatnonzero(~trajectory.is_validation)
        rows = rows[(rows >= LAGS - 1) & (rows < len(trajectory) - 1)]
        lower, upper = self._machine.lower, self._machine.upper
        speed = (trajectory.q[rows + 1] - trajectory.q[rows]) / self._machine.dt_s
        windows = trajectory.a[rows[:, None] + np.arange(1 - LAGS, 1)]
        return windows, 2.0 * (trajectory.q[rows] - lower) / (upper - lower) - 1.0, speed

    def _ask(self, question: dict, **arrays: np.ndarray) -> dict:
        file = Path(self._folder.name) / "question.npz"
        np.savez(file, **arrays)
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(json.dumps(question | {"file": str(file)}) + "\n")
        self._process.stdin.flush()
        line = self._process.stdout.readline()
        if not line:
            raise InputError(f"{self._process.args[0]} ended; its message stands above; does it have GPJax?")
        answer: dict = json.loads(line)
        return answer

    def close(self) -> None:
        """End the other process."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()
        self._folder.cleanup()


def fit_gaussian_process(
    python: str,
) -> Callable[[Sequence[Trajectory], MachineSpecification, int], GaussianProcess]:
    """A fit, as those of `kinds.py`, by that Python."""
    return lambda learning, machine, seed: GaussianProcess(python, learning, machine, seed)
