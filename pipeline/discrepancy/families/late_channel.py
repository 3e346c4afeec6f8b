"""One channel that makes all joints late: equal delays on every joint, which are one cause, reported as `timing`."""

from collections.abc import Collection, Sequence

import numpy as np

from pipeline.discrepancy.selection.candidate import Candidate

EQUAL_DELAYS_S, EQUAL_DELAYS_SHARE = 0.06, 0.25  # joints respond differently after one channel
SMALLEST_DELAY_SHARE = 0.5  # of the largest


def are_equal_delays(delays: Sequence[Candidate]) -> bool:
    """Whether they are as equal as those of one late channel, whose joints respond differently after it."""
    values = np.array([delay.point["added_delay"] for delay in delays])
    is_near = np.ptp(values) <= max(EQUAL_DELAYS_S, EQUAL_DELAYS_SHARE * float(np.median(values)))
    return bool(is_near and values.min() >= SMALLEST_DELAY_SHARE * values.max())


def set_in_together(one: Candidate, other: Candidate) -> bool:
    """Whether both act all the time, or may have set in at one moment."""
    if one.onset_between is None or other.onset_between is None:
        return one.onset == other.onset
    begins, ends = zip(one.onset_between, other.onset_between, strict=True)
    return max(begins) <= min(ends)


def late_channel(delays: Sequence[Candidate], excited: Collection[int]) -> list[Candidate]:
    """Those delays that are the channel's.

    Args:
        delays: That were found, one per joint.
        excited: Joints that move enough to tell. All of them, two at least, have to be late, from the same time on and
            alike; a delay of another joint belongs to the channel if it is like theirs.

    Returns:
        Empty where it is not the channel that is late.
    """
    telling = [delay for delay in delays if delay.joint in excited]
    if len(telling) < 2 or {delay.joint for delay in telling} != set(excited):
        return []
    if len({delay.onset for delay in telling}) > 1 or not are_equal_delays(telling):
        return []
    return [
        delay
        for delay in delays
        if delay.joint in excited or (delay.onset == telling[0].onset and are_equal_delays([*telling, delay]))
    ]
