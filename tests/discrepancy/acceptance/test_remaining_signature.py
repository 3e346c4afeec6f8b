"""A name whose signature is still there after the effect was taken off is not certain."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from pipeline.discrepancy.acceptance import remaining_signature as module
from pipeline.discrepancy.acceptance.remaining_signature import (
    RINGING,
    doubted_by_what_is_left,
    remaining_share,
    starts_and_stops,
)
from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows, averaged
from pipeline.discrepancy.families.plausibility import TIMING
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.grouping import OTHER, effects_of
from pipeline.discrepancy.selection.regression import Folds
from pipeline.discrepancy.selection.selected_effect import SelectedEffect
from tests.discrepancy.bare_candidate import bare_candidate

DT_S, N_ROWS, JOINT = 0.05, 8000, 1
LARGEST = 0.025
FOLD = np.arange(N_ROWS // 2) // 200 % 2


def commands(seed: int) -> np.ndarray:
    """(1, T, 2) held for half a second to three seconds each."""
    rng = np.random.default_rng(seed)
    held = [np.repeat(rng.integers(-1, 2, size=(1, 2)), rng.integers(10, 60), axis=0) for _ in range(400)]
    return np.concatenate(held)[None, :N_ROWS].astype(float)


COMMAND = commands(0)
NOISE = np.random.default_rng(1).normal(size=N_ROWS)
ROWS = ScoredRows(
    np.ones((1, N_ROWS), bool),
    Folds(FOLD, np.arange(N_ROWS // 2) // 100, N_ROWS // 200),
    np.ones(2),
    np.ones((N_ROWS // 2, 2)),
)
SIMULATION = SimpleNamespace(
    sequences=SimpleNamespace(command=COMMAND, stamp_ns=np.arange(N_ROWS)[None] * 50_000_000)
)


def columns(candidate: Candidate | None = None) -> np.ndarray:
    return starts_and_stops(SIMULATION, ROWS, candidate or bare_candidate("lag", JOINT), DT_S)


def lagging(time_constant_s: float) -> np.ndarray:
    """(T,) response of a first-order lag to the joint's command, discretised backwards."""
    share = DT_S / (time_constant_s + DT_S)
    return np.asarray(lfilter([share], [1.0, share - 1.0], COMMAND[0, :, JOINT]))


def late(rows: int) -> np.ndarray:
    return np.concatenate([np.zeros(rows), COMMAND[0, : N_ROWS - rows, JOINT]])


def mean(values: np.ndarray) -> np.ndarray:
    return averaged(values[None, :, None], ROWS.is_used)[:, 0]


def test_of_the_right_effect_noise_is_left_and_of_another_the_starts_and_stops() -> None:
    lagged, now = lagging(0.3), COMMAND[0, :, JOINT]
    noise = 0.05 * NOISE
    without = mean(lagged - now + noise)
    assert remaining_share(without, mean(noise), columns(), FOLD) < 0.002
    best = min((late(rows) for rows in range(12)), key=lambda v: float(np.sum((lagged - v) ** 2)))
    share = remaining_share(without, mean(lagged - best + noise), columns(), FOLD)
    assert share > 4 * LARGEST


def test_share_is_what_is_left_in_units_of_what_was_removed() -> None:
    signature = mean(lagging(0.3) - COMMAND[0, :, JOINT])
    for left in (0.1, 0.3):
        expected = left**2 / (1.0 - left**2)
        share = remaining_share(signature, left * signature, columns(), FOLD)
        assert share == pytest.approx(expected, rel=0.03)


def test_late_after_reversals_and_early_after_other_starts_is_a_signature_though_starts_are_right_in_the_mean() -> (
    None
):
    pulse, last = np.zeros(N_ROWS), 0.0
    reversing, going_on = [], []
    for row in range(1, N_ROWS - 10):
        before, now = COMMAND[0, row - 1 : row + 1, JOINT]
        last = before or last
        if now not in (0.0, before):
            (going_on if now == last else reversing).append(row)
    assert min(len(reversing), len(going_on)) > 20
    for starts in (reversing, going_on):
        for row in starts:
            sign = COMMAND[0, row, JOINT] * (-1.0 if starts is reversing else 1.0)
            pulse[row : row + 6] = sign * min(len(reversing), len(going_on)) / len(starts)
    noise = mean(0.05 * NOISE)
    without = 3.0 * mean(pulse) + noise
    assert remaining_share(without, mean(pulse) + noise, columns(), FOLD) > 2 * LARGEST
    assert remaining_share(without, noise, columns(), FOLD) < 0.002


def test_a_small_part_of_what_is_left_is_no_signature() -> None:
    signature = mean(lagging(0.3) - COMMAND[0, :, JOINT])
    for noise, is_told in ((0.05, True), (2.0, False)):
        rest = 0.3 * signature + noise * mean(NOISE)
        share = remaining_share(signature + noise * mean(NOISE), rest, columns(), FOLD)
        assert (share > LARGEST) == is_told


def test_another_joints_starts_and_stops_are_not_looked_at() -> None:
    signature = mean(lagging(0.3) - COMMAND[0, :, JOINT])
    of_other = columns(bare_candidate("lag", 0))
    assert abs(remaining_share(signature, 0.3 * signature, of_other, FOLD)) < 0.02


def test_what_removes_nothing_leaves_no_share() -> None:
    signature = mean(lagging(0.3))
    assert remaining_share(signature, signature, columns(), FOLD) == 0.0


def test_before_its_onset_nothing_is_expected_of_it() -> None:
    since = replace(bare_candidate("lag", JOINT), onset=4000 * 50_000_000)
    seen, always = columns(since), columns()
    assert not np.any(seen[:2000])
    np.testing.assert_array_equal(seen[2000:], always[2000:])
    unsure = replace(since, onset_between=(since.onset, 4200 * 50_000_000))
    np.testing.assert_array_equal(columns(unsure)[2100:], always[2100:])
    assert not np.any(columns(unsure)[:2100])


def test_commands_of_any_size_start_and_stop_as_whole_ones_do() -> None:
    small = SimpleNamespace(sequences=SimpleNamespace(command=0.3 * COMMAND, stamp_ns=None))
    seen = starts_and_stops(small, ROWS, bare_candidate("lag", JOINT), DT_S)
    np.testing.assert_array_equal(seen, columns())


def test_a_stick_that_trembles_at_rest_starts_nothing() -> None:
    trembling = np.where(COMMAND == 0.0, 1e-4 * np.random.default_rng(3).normal(size=COMMAND.shape), COMMAND)
    at_rest = SimpleNamespace(sequences=SimpleNamespace(command=trembling, stamp_ns=None))
    seen = starts_and_stops(at_rest, ROWS, bare_candidate("lag", JOINT), DT_S)
    np.testing.assert_array_equal(seen, columns())


def doubted(
    effect: Candidate, left: float, monkeypatch: pytest.MonkeyPatch, screened: list[Candidate]
) -> list[str]:
    """Families that stand beside the effect, of which so large a part is left."""
    signature = np.tile(mean(lagging(0.3) - COMMAND[0, :, JOINT])[:, None], 2)
    monkeypatch.setattr(
        module, "residual_of", lambda simulation, rows, found: (left if found else 1.0) * signature
    )
    (found,) = doubted_by_what_is_left(SIMULATION, ROWS, [SelectedEffect(effect)], screened, LARGEST, DT_S)
    return [c.family for c in found.equivalents]


SCREENED = [
    replace(bare_candidate(family, joint), gain=1.0)
    for joint in (0, JOINT)
    for family in ("gain", "lag", "delay", "stiction", "oscillation", "leakage", "backlash")
]


def test_what_its_card_is_confounded_with_on_its_joint_stands_beside_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    delay = bare_candidate("delay", JOINT)
    assert doubted(delay, 0.05, monkeypatch, SCREENED) == []
    assert doubted(delay, 0.4, monkeypatch, SCREENED) == ["lag", "stiction", "backlash"]
    assert doubted(bare_candidate("gain", JOINT), 0.4, monkeypatch, SCREENED) == []
    assert doubted(bare_candidate("sensor_bias", JOINT), 0.4, monkeypatch, SCREENED) == [
        *("lag", "delay", "stiction", "oscillation", "backlash")
    ]


def test_a_resonance_that_does_not_ring_is_a_lag_by_another_name(monkeypatch: pytest.MonkeyPatch) -> None:
    for damping, expected in ((RINGING - 0.1, []), (RINGING + 0.1, ["lag"])):
        mode = replace(
            bare_candidate("oscillation", JOINT), point={"frequency": 1.0, "damping_ratio": damping}
        )
        assert doubted(mode, 0.05, monkeypatch, SCREENED) == expected


def test_a_late_channel_that_may_not_be_named_is_no_delay_of_each_joint() -> None:
    late_joints = [
        SelectedEffect(replace(bare_candidate("delay", joint), point={"added_delay": 0.15}))
        for joint in range(4)
    ]
    assert [effect.family for effect in effects_of(late_joints, range(4))] == [TIMING]
    (effect,) = effects_of(late_joints, range(4), allow_timing=False)
    assert effect.family == OTHER
    assert effect.joints == [0, 1, 2, 3]
