"""The MuJoCo arm's drives against closed forms: steady speed, delay, leakage, play; effects at their bounds."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from benchmarks.closed_loop.kinematic.operator import Driver
from benchmarks.closed_loop.machines import variant
from benchmarks.closed_loop.mujoco_arm import effects
from benchmarks.closed_loop.mujoco_arm.arm import STEP_S, draw_arm
from benchmarks.closed_loop.mujoco_arm.hydraulics import rods
from benchmarks.closed_loop.mujoco_arm.operator import sticks
from benchmarks.closed_loop.mujoco_arm.session import N_STEP, PERIOD_S, Run, record_session
from benchmarks.closed_loop.simulators import MUJOCO
from pipeline.errors import InputError
from pipeline.machine.specification import JointKind

DRAWN = variant(MUJOCO, 8).parameters
N = len(DRAWN.links)
MIDDLE = 0.5 * (DRAWN.specification.lower + DRAWN.specification.upper)
SPAN = DRAWN.specification.upper - DRAWN.specification.lower


def quiet(arm):
    """Without chances, friction and overlap, and with a pump that never lacks oil; links hardly weigh."""
    links = tuple(replace(link, friction=0.0, mass_kg=1e-3 * link.mass_kg) for link in arm.links)
    arm = replace(arm, links=links, gravity_m_s2=0.0)
    zeros = np.zeros(N)
    arm = arm.change("valve", noise_std=0.0, dead_time_jitter_s=0.0, overlap=zeros)
    arm = arm.change("supply", wander_std=0.0, flow_m3_s=1.0, gain_m3_s_Pa=1e-6)
    return arm.change("cylinder", leakage_m3_s_Pa=zeros)


QUIET = quiet(DRAWN)


def driven(arm, joint, *holds, start=MIDDLE):
    """(K, n) positions every `STEP_S`, with (command, s) after one another on one joint."""
    commands = np.concatenate([np.full(round(s / PERIOD_S), command) for command, s in holds])
    run = Run(arm, len(commands), 1, start)
    for period, command in enumerate(commands):
        run.advance(period, command * np.eye(N)[joint], arm)
    return run.path


def speed(path, joint):
    return np.gradient(path[:, joint], STEP_S)


def steady_speed(arm, joint, position):
    """Both ports drop half of what the rod's drag leaves of the supply's pressure (Merritt, section 6-1)."""
    cylinder, valve = arm.quantities.cylinder, arm.quantities.valve
    area = cylinder.area_m2[joint]
    per_root_Pa, drag_Pa = valve.conductance[joint, 1] / area, cylinder.viscous_N_s_m[joint] / area
    # v² = k² / A² (p - c v / A) / 2
    half = 0.25 * per_root_Pa**2 * drag_Pa
    rod_m_s = -half + np.sqrt(half**2 + 0.5 * per_root_Pa**2 * arm.quantities.supply.pressure_Pa)
    return rod_m_s / rods(arm.transmission, position)[1][joint]


@pytest.mark.parametrize("joint", range(N))
def test_a_full_command_gives_the_flow_of_two_equal_orifices(joint):
    path = driven(QUIET, joint, (1.0, 1.5), start=MIDDLE - 0.3 * SPAN)
    assert speed(path, joint)[-40] == pytest.approx(steady_speed(QUIET, joint, path[-40]), rel=0.01)
    others = np.delete(path, joint, axis=1)
    assert np.abs(others - others[0]).max() < 0.01


def test_a_gain_is_a_ratio_of_speeds():
    drawn = [effects.draw("gain", seed, QUIET, 1.0) for seed in range(9)]
    effect = next(e for e in drawn if e.truth["direction"].value != -1)
    joint = QUIET.specification.joint_names.index(effect.joints[0])
    free = QUIET.change("cylinder", viscous_N_s_m=np.zeros(N))  # what drag costs has nothing to do with ports
    slow, sound = (steady_speed(arm, joint, MIDDLE) for arm in (effect.apply(free), free))
    assert slow / sound == pytest.approx(effect.truth["speed_ratio"].value)


def test_a_delay_shifts_all_that_follows():
    joint, added_s = 1, 0.15
    dead_s = QUIET.quantities.valve.dead_time_s
    late = QUIET.change("valve", dead_time_s=np.where(np.arange(N) == joint, dead_s + added_s, dead_s))
    sound, shifted = (driven(arm, joint, (1.0, 0.5), (-1.0, 0.5), (0.0, 0.5)) for arm in (QUIET, late))
    steps = round(added_s / STEP_S)
    np.testing.assert_allclose(shifted[steps:, joint], sound[:-steps, joint], atol=2e-4 * SPAN[joint])


def test_a_joint_that_carries_weight_sags_as_its_piston_leaks():
    joint = next(k for k, link in enumerate(DRAWN.links) if link.axis[1] == 1.0)
    arm = replace(QUIET, links=tuple(replace(link, friction=0.0) for link in DRAWN.links), gravity_m_s2=9.81)
    area = arm.quantities.cylinder.area_m2[joint]
    leak = np.where(np.arange(N) == joint, 2e-13 * area / 1e-3, 0.0)
    arm = arm.change("cylinder", leakage_m3_s_Pa=leak)
    path = driven(arm, joint, (0.0, 2.0))
    data = mujoco.MjData(arm.model)
    data.qpos[:] = path[-200]
    mujoco.mj_forward(arm.model, data)
    lever = rods(arm.transmission, path[-200])[1][joint]
    wanted = -leak[joint] * data.qfrc_bias[joint] / (area * lever) ** 2
    measured = (path[-1, joint] - path[-401, joint]) / (400 * STEP_S)
    assert abs(wanted) > 1e-4 and measured == pytest.approx(wanted, rel=0.05)


def test_play_is_lost_on_reversal():
    """The link stands, held by friction, while the rod crosses the play, faster than it goes with the link."""
    joint, share = 1, 0.05
    pairs = zip(QUIET.links, DRAWN.links, strict=True)
    arm = replace(QUIET, links=tuple(replace(link, friction=10.0 * own.friction) for link, own in pairs))
    arm = arm.change("cylinder", viscous_N_s_m=np.zeros(N))
    width, lever = share * SPAN[joint], rods(arm.transmission, MIDDLE)[1][joint]
    loose = arm.change("cylinder", play_m=np.where(np.arange(N) == joint, width * lever, 0.0))
    holds = ((1.0, 0.8), (0.0, 0.5), (-1.0, 1.5))
    tight_path, loose_path = (driven(of, joint, *holds)[:, joint] for of in (arm, loose))
    lost = (loose_path[-1] - loose_path.max()) - (tight_path[-1] - tight_path.max())
    strongest = arm.quantities.cylinder.area_m2[joint] * lever * arm.quantities.supply.pressure_Pa
    assert lost == pytest.approx(width * np.sqrt(1.0 - arm.links[joint].friction / strongest), rel=0.1)


def test_a_start_after_a_rest_sticks_as_long_as_it_is_drawn():
    joint, mean_s = 1, 0.4
    valve = {"mean_extra_time_s": np.full(N, mean_s), "rest_threshold_s": np.full(N, 0.5)}
    sticky = QUIET.change("valve", **valve)
    begins = [
        np.argmax(np.abs(driven(of, joint, (1.0, 2.0))[:, joint] - MIDDLE[joint]) > 1e-3 * SPAN[joint])
        for of in (QUIET, sticky)
    ]
    run = Run(sticky, 40, 1, MIDDLE)
    period = int((DRAWN.quantities.valve.dead_time_s[joint]) / PERIOD_S)
    assert (begins[1] - begins[0]) * STEP_S == pytest.approx(mean_s * run._extra[period, joint], abs=0.01)


def test_arms_differ_in_joints_and_some_are_prismatic():
    arms = [draw_arm(seed) for seed in range(30)]
    assert {len(arm.links) for arm in arms} == set(range(3, 8))
    is_prismatic = [link.joint.kind is JointKind.prismatic for arm in arms for link in arm.links]
    assert 0.1 < np.mean(is_prismatic) < 0.4
    for arm in arms:
        assert np.all(arm.quantities.supply.modulus_Pa > 0.0) and np.all(
            arm.quantities.cylinder.area_m2 > 0.0
        )


class Pushed(Driver):
    """All sticks to one side, then to the other."""

    def __init__(self):
        self.n = 0

    def command(self, measured):
        self.n += 1
        return np.full(N, 1.0 if self.n < 80 else -1.0)


def test_stops_hold():
    log = record_session(DRAWN, Pushed(), 10 / 60, 1, 0)
    assert np.all(log.true_positions > DRAWN.specification.lower - 0.02 * SPAN)
    assert np.all(log.true_positions < DRAWN.specification.upper + 0.02 * SPAN)


def test_a_twin_goes_on_from_the_same_state():
    run = Run(QUIET, 60, 1, MIDDLE)
    for period in range(60):
        if period == 30:
            twin = run.twin(30, 30, 2)
        run.advance(period, np.full(N, 0.5), QUIET)
    for period in range(30, 60):
        twin.advance(period, np.full(N, 0.5), QUIET)
    np.testing.assert_allclose(twin.path[30 * N_STEP :], run.path[30 * N_STEP :], atol=1e-9)


@pytest.mark.parametrize("kind", effects.KINDS)
def test_every_kind_works_at_its_smallest_and_largest(kind):
    for share in (0.05, 1.0):
        effect = effects.draw(kind, 3, DRAWN, share * effects.LARGEST_SIZE[kind])
        assert effect.joints and effect.depends_on
        assert (effect.family == "other") == (kind in effects.OUTSIDE)
        at_sticks = sticks(DRAWN.specification, 1, 2)
        log = record_session(effect.apply(DRAWN), at_sticks, 4 / 60, 3, 0)
        assert np.isfinite(log.positions).all()
        assert np.abs(np.diff(log.true_positions, axis=0)).max() < 0.2


def test_sizes_out_of_bounds_and_unknown_kinds_are_refused():
    for kind, size in (("gain", 0.0), ("gain", 9.0), ("gremlins", 1.0)):
        with pytest.raises(InputError, match=kind):
            effects.draw(kind, 0, DRAWN, size)
