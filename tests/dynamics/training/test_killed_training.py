"""A process that is killed in the middle of training: started again, it ends with the same bits."""

import signal
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
import pytest

from tests.dynamics.killed_training import train

REPOSITORY = Path(__file__).parents[3]


@pytest.mark.long
def test_a_killed_process_goes_on_to_bit_equal_parameters(tmp_path):
    arguments = [jax.config.jax_compilation_cache_dir, tmp_path / "checkpoints", tmp_path / "result.npz"]
    command = [sys.executable, "-m", "tests.dynamics.killed_training", *map(str, arguments)]
    with subprocess.Popen(command, cwd=REPOSITORY, stdout=subprocess.PIPE, text=True) as training:
        for line in training.stdout:
            if int(line) == 3:
                training.kill()
                break
        before = [int(line) for line in training.stdout]
        assert training.wait() == -signal.SIGKILL
    last = max([3, *before])
    assert not (tmp_path / "result.npz").exists()

    again = subprocess.run(command, cwd=REPOSITORY, check=True, capture_output=True, text=True)
    epochs = [int(line) for line in again.stdout.splitlines()]
    assert epochs == list(range(epochs[0], 26))
    assert last <= epochs[0] <= last + 1  # at most the epoch whose checkpoint was not complete is repeated

    whole = train(checkpoints=None)
    with np.load(tmp_path / "result.npz") as resumed:
        for index, leaf in enumerate(jax.tree.leaves(whole.parameters)):
            np.testing.assert_array_equal(resumed[f"arr_{index}"], leaf)
        for name, curve in whole.curves.items():
            np.testing.assert_array_equal(resumed[name], curve)
