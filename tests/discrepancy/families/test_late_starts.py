"""Late starts: a joint whose every start, and its lock after rests, are known in closed form."""

import numpy as np
import pytest

from pipeline.discrepancy.diagnosis.sequences import Sequences
from pipeline.discrepancy.families.late_starts import late_starts

DT_S, SUBSTEPS = 0.05, 20
FINE_S = DT_S / SUBSTEPS
THRESHOLD_S = 0.5
RISE_S, DEAD_S = 0.2, 0.1
ENCODER_NOISE_RAD = 4e-4  # the plant's
GAMMA_SHAPE = 4.0


def logs(
    extra_s: float, seed: int, speed: float = 0.5, spread: bool = False, late_rows: float = 0.0
) -> Sequences:
    """Moves and rests of any length; after a rest longer than the threshold a move begins later.

    Args:
        extra_s: by how much, in the mean.
        seed: of everything.
        speed: of the joint, rad/s.
        spread: whether extra times are of a gamma distribution; else they are all the same.
        late_rows: by which the log is read late.
    """
    random = np.random.default_rng(seed)
    targets, is_held, commands = [], [], []
    for number in range(160):
        sign = 1 if number % 2 else -1
        rest, move = int(random.integers(4, 60)), int(random.integers(25, 60))
        waiting = random.gamma(GAMMA_SHAPE, extra_s / GAMMA_SHAPE) if spread else extra_s
        for command, n, late_s in (
            (0, rest, DEAD_S),
            (sign, move, DEAD_S + 0.1 * (sign > 0) + waiting * (rest * DT_S > THRESHOLD_S)),
        ):
            since_s = FINE_S * np.arange(n * SUBSTEPS)
            commands += [command] * n
            targets.append(np.full(n * SUBSTEPS, command * speed))
            is_held.append(since_s < late_s)
    target, held = np.concatenate(targets), np.concatenate(is_held)
    v = np.zeros(len(target))
    for step in range(1, len(v)):
        wanted = 0.0 if held[step] and target[step] != 0.0 else v[step - 1] if held[step] else target[step]
        v[step] = v[step - 1] + FINE_S / RISE_S * (wanted - v[step - 1])
    rows = np.roll(v, round(late_rows * SUBSTEPS)).reshape(-1, SUBSTEPS).mean(axis=1)
    q = np.concatenate([[0.0], np.cumsum(DT_S * rows)]) + ENCODER_NOISE_RAD * random.standard_normal(
        len(rows) + 1
    )
    n = len(rows)
    return Sequences(
        command=np.array(commands, float)[None, :, None],
        q=q[None, :-1, None],
        velocity=(np.diff(q) / DT_S)[None, :, None],
        time_s=DT_S * np.arange(n)[None],
        stamp_ns=np.arange(n)[None],
        is_row=np.ones((1, n), bool),
    )


def found(measured: Sequences, phase: float = 0.0, speed: float = 0.5):
    nominal = logs(0.0, seed=1, speed=speed)
    return late_starts((nominal, np.zeros(1)), (measured, np.array([phase])), 0, THRESHOLD_S, speed, DT_S)


@pytest.mark.parametrize("extra_s", [0.1, 0.25, 0.43, 0.8])
@pytest.mark.parametrize("speed", [0.25, 0.5])  # the slowest joint of the contract: 25 mrad/s, noise of 11
def test_the_extra_time_is_that_of_the_machine(extra_s: float, speed: float) -> None:
    late = found(logs(extra_s, seed=2, speed=speed), speed=speed)
    assert late.extra_s == pytest.approx(extra_s, abs=0.02)
    assert abs(late.extra_s - extra_s) < 4.0 * late.extra_deviation_s + 0.01


@pytest.mark.parametrize("extra_s", [0.25, 0.5])
def test_late_starts_of_all_lengths_count(extra_s: float) -> None:
    late = found(logs(extra_s, seed=4, spread=True))
    assert abs(late.extra_s - extra_s) < 3.0 * late.extra_deviation_s
    assert late.extra_deviation_s < 0.15 * extra_s


def test_a_sound_machine_starts_as_it_did_and_stops_in_closed_form() -> None:
    late = found(logs(0.0, seed=3))
    assert late.extra_s == pytest.approx(0.0, abs=0.01)
    to_a_tenth_of_full_speed_s = DEAD_S + RISE_S * np.log(10.0)
    assert late.stopping_s == pytest.approx(to_a_tenth_of_full_speed_s, abs=0.05)


def test_a_log_read_late_is_not_a_joint_that_starts_late() -> None:
    read_late = logs(0.2, seed=2, late_rows=0.4)
    assert found(read_late, phase=0.4).extra_s == pytest.approx(0.2, abs=0.01)
    assert found(read_late).extra_s == pytest.approx(0.2 + 0.4 * DT_S, abs=0.01)


def test_few_starts_tell_nothing() -> None:
    measured = logs(0.2, seed=2)
    short = measured._replace(is_row=np.arange(measured.is_row.shape[1])[None] < 200)
    assert found(short) is None
