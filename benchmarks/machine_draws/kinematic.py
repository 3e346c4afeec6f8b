"""Kinematic machines whose constants are all drawn: `draw_machine`, which varies one build, and what it leaves alike.

Full speeds are the contract's (section 1: 0.25 to 0.7 rad/s). The other ranges are assumed, about the values of
`benchmarks/closed_loop/kinematic/machine.py`.
"""

from dataclasses import replace

import numpy as np

from benchmarks.closed_loop.kinematic.machine import SPEED_TOLERANCE, Machine, Work, draw_machine
from pipeline.machine.specification import MachineSpecification

SPEED_RAD_S = (0.25, 0.70)  # contract, section 1
DEAD_TIME_JITTER_S = (0.005, 0.025)  # half the cycle of a controller of 10 to 50 ms
SLOW_CORRELATION_S = (10.0, 40.0)
FAST_CORRELATION_S = (0.2, 0.8)
ENCODER_JITTER_S = (0.001, 0.004)
ENCODER_BITS = (12, 14)


def draw_kinematic(specification: MachineSpecification, seed: int) -> Machine:
    """A machine whose constants are all drawn, and what it is used for.

    Args:
        specification: Names and limits.
        seed: Of everything.

    Raises:
        InputError: The machine does not have the joints that the simulator describes.
    """
    build_seed, seed_of_rest = np.random.SeedSequence(seed).generate_state(2).tolist()
    random = np.random.default_rng(seed_of_rest)
    machine = draw_machine(specification, 0, build_seed)
    n = specification.n_joint
    middle = random.uniform(
        SPEED_RAD_S[0] / (1 - SPEED_TOLERANCE), SPEED_RAD_S[1] / (1 + SPEED_TOLERANCE), (n, 1)
    )
    machine = machine.change(
        "speed",
        full_speed_rad_s=middle * random.uniform(1.0 - SPEED_TOLERANCE, 1.0 + SPEED_TOLERANCE, (n, 2)),
        slow_correlation_s=random.uniform(*SLOW_CORRELATION_S),
        fast_correlation_s=random.uniform(*FAST_CORRELATION_S),
    )
    machine = machine.change("command_path", dead_time_jitter_s=random.uniform(*DEAD_TIME_JITTER_S))
    bits = random.integers(ENCODER_BITS[0], ENCODER_BITS[1], endpoint=True)
    machine = machine.change(
        "encoder", jitter_s=random.uniform(*ENCODER_JITTER_S), quantum_rad=2.0 * np.pi / 2.0**bits
    )
    works = list(Work)
    return replace(machine, work=works[random.integers(len(works))])
