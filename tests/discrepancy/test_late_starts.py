"""Late starts: a joint whose every start, and its lock after rests, are known in closed form."""

import numpy as np
import pytest

from pipeline.discrepancy.late_starts import late_starts
from pipeline.discrepancy.sequences import Sequences

DT_S, SPEED, SUBSTEPS = 0.05, 0.5, 20
RISE_S, DEAD_S = 0.2, 0.1


def logs(extra_s: float, threshold_s: float, seed: int) -> Sequences:
    """Moves and rests of any length; after a rest longer than the threshold a move begins `extra_s` later."""
    random = np.random.default_rng(seed)
    fine = DT_S / SUBSTEPS
    commands, velocity = [], []
    v, waiting, rest_s = 0.0, 0.0, 9.0
    sign = 1
    for _ in range(120):
        rest, move = random.integers(4, 60), random.integers(25, 50)
        for command, n in ((0, rest), (sign, move)):
            for step in range(n):
                commands.append(command)
                rows = []
                for part in range(SUBSTEPS):
                    since_s = step * DT_S + part * fine
                    if command == 0:
                        rest_s = since_s if since_s > 0 else 0.0
                    elif since_s == 0.0:
                        waiting = extra_s if rest_s > threshold_s else 0.0
                    is_before = since_s < DEAD_S + (waiting if command else 0.0)
                    v += fine / RISE_S * (0.0 if is_before else command * SPEED - v)
                    rows.append(v)
                velocity.append(np.mean(rows))
        sign = -sign
    n = len(velocity)
    return Sequences(
        command=np.array(commands, float)[None, :, None],
        q=np.zeros((1, n, 1)),
        velocity=np.array(velocity)[None, :, None] + 2e-3 * random.standard_normal((1, n, 1)),
        time_s=DT_S * np.arange(n)[None],
        stamp_ns=np.arange(n)[None],
        is_row=np.ones((1, n), bool),
    )


def found(measured: Sequences, phase: float = 0.0):
    nominal = logs(0.0, 0.5, seed=1)
    return late_starts((nominal, np.zeros(1)), (measured, np.array([phase])), 0, 0.5, SPEED, DT_S)


@pytest.mark.parametrize("extra_s", [0.1, 0.25, 0.43])
def test_the_extra_time_is_that_of_the_machine(extra_s: float) -> None:
    late = found(logs(extra_s, 0.5, seed=2))
    assert late.extra_s == pytest.approx(extra_s, abs=0.015)
    assert abs(late.extra_s - extra_s) < 4.0 * late.extra_deviation_s + 0.005


def test_a_sound_machine_starts_as_it_did_and_stops_in_closed_form() -> None:
    late = found(logs(0.0, 0.5, seed=3))
    assert late.extra_s == pytest.approx(0.0, abs=0.005)
    assert late.stopping_s == pytest.approx(
        DEAD_S + RISE_S * np.log(10.0), abs=0.05
    )  # to a tenth of full speed


def test_a_log_read_late_is_not_a_joint_that_starts_late() -> None:
    assert found(logs(0.2, 0.5, seed=2), phase=0.4).extra_s == pytest.approx(0.2 - 0.4 * DT_S, abs=0.015)


def test_few_starts_tell_nothing() -> None:
    measured = logs(0.2, 0.5, seed=2)
    short = measured._replace(is_row=np.arange(measured.is_row.shape[1])[None] < 200)
    assert found(short) is None
