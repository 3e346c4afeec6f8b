"""A clock that is set, told from messages that were held up, had stray stamps or were of another publisher."""

import numpy as np
import pytest

from pipeline.logs.conditioning import clock_steps
from pipeline.logs.conditioning.clock_steps import step_apart_ns
from pipeline.logs.messages.columns import sections

SECOND = 1_000_000_000
GAP_NS = SECOND // 2
STAMP = 1_700_000_000 * SECOND + np.arange(2000) * 20_000_000


def late(stamp_ns, delay_s):
    """Log times of messages that are held up, and keep their order."""
    return np.maximum.accumulate(stamp_ns + (np.asarray(delay_s) * SECOND).astype(np.int64))


def held_up(at, seconds, drained_within_s=0.0):
    """Log times with a pause of the connection; what waited then comes at once, or faster than it was sent."""
    log_time = STAMP.copy()
    since = STAMP - STAMP[at]
    waiting = (since >= 0) & (since < int((seconds + drained_within_s) * SECOND))
    sent = since[waiting] / (seconds + drained_within_s)
    log_time[waiting] = STAMP[at] + int(seconds * SECOND) + (sent * drained_within_s).astype(np.int64)
    return log_time


@pytest.mark.parametrize("section_rows", [7, 100, 1 << 15])
@pytest.mark.parametrize("by_s", [0.7, 30.0, -0.7, -30.0])
@pytest.mark.parametrize("at", [100, 1000, 1900])
def test_a_step_of_either_clock(monkeypatch, by_s, at, section_rows):
    monkeypatch.setattr(clock_steps, "sections", lambda columns: sections(columns, n_rows=section_rows))
    rng = np.random.default_rng(0)
    stepped = late(STAMP, rng.uniform(0, 0.05, 2000)) + int(by_s * SECOND) * (np.arange(2000) >= at)
    assert step_apart_ns(STAMP, stepped, GAP_NS) == pytest.approx(by_s * SECOND, abs=0.06 * SECOND)
    assert step_apart_ns(stepped, STAMP, GAP_NS) == pytest.approx(-by_s * SECOND, abs=0.06 * SECOND)


@pytest.mark.parametrize(
    "log_time",
    [
        held_up(1000, 2.0),
        held_up(0, 2.0),
        held_up(1960, 0.3),
        held_up(1000, 5.0, drained_within_s=3.0),
        late(STAMP, np.where(np.arange(2000) % 500 == 0, 0.8, 0)),  # one in 10 s
        STAMP + np.where(np.arange(2000) % 2, 700_000_000, 0),  # two publishers, one slow
        STAMP + np.linspace(0, 1.5 * SECOND, 2000).astype(np.int64),  # a clock that runs fast
        STAMP - np.linspace(0, 1.5 * SECOND, 2000).astype(np.int64),
        np.where(np.isin(np.arange(2000), [500, 501, 1200]), STAMP + 3600 * SECOND, STAMP),  # stray
        np.where(np.isin(np.arange(2000), [0, 1, 1999]), STAMP - 3600 * SECOND, STAMP),
        np.where(np.arange(2000) < 5, 0, STAMP),  # unset
    ],
)
def test_what_is_no_step(log_time):
    assert step_apart_ns(STAMP, log_time, GAP_NS) == 0


def test_stamps_of_whole_seconds():
    assert step_apart_ns(STAMP // SECOND * SECOND, STAMP, GAP_NS) == 0
