"""Every term against hand-computed values, and all against float64 NumPy on random states."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.reaching.reward import (
    Deviation,
    RewardConfig,
    RewardTerm,
    RewardTerms,
    action_penalty,
    angles_are_precise,
    configuration_is_precise,
    configuration_penalty,
    euclidean_norm,
    geodesic_distance,
    pose_is_precise,
    pose_penalty,
    precision_bonus,
    reward_terms,
    total_reward,
    workspace_penalty,
)
from tests.reaching import reference


def deviation(
    position=0.0, rotation=0.0, yaw=0.0, pitch=0.0, configuration=(0.0, 0.0, 0.0, 0.0)
) -> Deviation:
    return Deviation(*(jnp.asarray(value) for value in (position, rotation, yaw, pitch, configuration)))


def quaternion(axis, angle):
    return np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * np.asarray(axis, float)])


# --- distances


@pytest.mark.parametrize("angle", [0.0, 1e-3, 0.1, 1.0, np.pi / 2, 3.0, np.pi])
def test_geodesic_distance_is_the_angle_in_half_turns(angle):
    target, other = quaternion([0, 0, 1], 0.3), quaternion([0, 0, 1], 0.3 + angle)
    for sign in (1.0, -1.0):  # a quaternion and its negative are the same orientation
        got = geodesic_distance(jnp.asarray(target, jnp.float32), jnp.asarray(sign * other, jnp.float32))
        np.testing.assert_allclose(got, angle / np.pi, atol=2e-6)


def test_geodesic_distance_has_no_nan_at_equality_nor_in_its_gradient():
    r = jnp.asarray(quaternion([0.6, 0.0, 0.8], 1.1), jnp.float32)
    assert geodesic_distance(r, r) == 0.0
    assert np.isfinite(jax.grad(lambda x: geodesic_distance(r, x))(r)).all()
    assert np.isfinite(jax.grad(lambda x: geodesic_distance(r, x))(r + 1e-4)).all()


def test_euclidean_norm_has_gradient_zero_at_the_origin():
    np.testing.assert_array_equal(jax.grad(euclidean_norm)(jnp.zeros(3)), np.zeros(3))
    np.testing.assert_allclose(jax.grad(euclidean_norm)(jnp.array([3.0, 4.0])), [0.6, 0.8], rtol=1e-6)


# --- terms, by hand


def test_pose_penalty(paper_reward):
    np.testing.assert_allclose(pose_penalty(paper_reward, deviation(position=0.75, rotation=0.25)), -1.0)
    weighted = dataclasses.replace(paper_reward, position_weight=2.0, rotation_weight=4.0)
    np.testing.assert_allclose(pose_penalty(weighted, deviation(position=0.75, rotation=0.25)), -2.5)


def test_configuration_penalty_is_the_norm(paper_reward):
    d = deviation(configuration=(0.1, -0.2, 0.2, 0.4))  # squares 0.01 + 0.04 + 0.04 + 0.16 = 0.25
    np.testing.assert_allclose(configuration_penalty(paper_reward, d), -0.5, rtol=1e-6)


@pytest.mark.parametrize(
    ("position", "rotation", "expected"),
    [
        (0.2, 0.0, 0.0),  # too far
        (0.0, 0.2, 0.0),  # turned too far
        (0.09, 0.09, 0.5),  # coarse
        (0.06, 0.01, 0.5),  # fine in rotation only
        (0.04, 0.03, 0.5),  # fine in position only
        (0.04, 0.01, 1.0),  # coarse and fine
        (0.1, 0.0, 0.0),  # strict
    ],
)
def test_both_pose_bonuses(paper_reward, position, rotation, expected):
    d = deviation(position, rotation, yaw=1.0, pitch=1.0, configuration=(1.0, 1.0, 1.0, 1.0))
    np.testing.assert_allclose(precision_bonus(paper_reward, d), expected)


def test_single_bonus_functions():
    assert pose_is_precise(deviation(position=0.03, rotation=0.01), 0.05, 0.02)
    assert not pose_is_precise(deviation(position=0.03, rotation=0.03), 0.05, 0.02)
    assert angles_are_precise(deviation(yaw=0.009, pitch=-0.009), 1e-4)
    assert not angles_are_precise(deviation(yaw=0.009, pitch=-0.011), 1e-4)
    assert not angles_are_precise(deviation(yaw=0.011, pitch=0.0), 1e-4)
    assert configuration_is_precise(deviation(configuration=(0.049, -0.049, 0.0, 0.049)), 2.5e-3)
    assert not configuration_is_precise(deviation(configuration=(0.0, -0.051, 0.0, 0.0)), 2.5e-3)


def test_angle_and_configuration_bonus_add_up(paper_reward):
    far = deviation(position=1.0, rotation=0.5)
    np.testing.assert_allclose(precision_bonus(paper_reward, far), 2.0)
    turned = far._replace(yaw=jnp.asarray(0.02))
    np.testing.assert_allclose(precision_bonus(paper_reward, turned), 1.0)
    np.testing.assert_allclose(precision_bonus(paper_reward, deviation()), 3.0)  # all at once


def test_action_penalty_is_the_mean_change(paper_reward):
    a, previous = jnp.array([1.0, 0.0, -1.0, 0.0]), jnp.array([-1.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(action_penalty(paper_reward, a, previous), -0.5 * 3 / 4)
    np.testing.assert_allclose(action_penalty(paper_reward, a, a), 0.0)


def test_workspace_penalty(paper_reward):
    np.testing.assert_allclose(workspace_penalty(paper_reward, jnp.array([True, False])), [0.0, -2.0])


# --- all terms, against the reference


def random_states(n: int, seed: int) -> list[dict]:
    """Half of the states near their target, on the scale of the thresholds."""
    rng = np.random.default_rng(seed)
    states = []
    for i in range(n):
        scale = 1.0 if i % 2 else 10 ** rng.uniform(-3, -0.5)
        q_target = rng.uniform(-1, 1, 4)
        q = q_target + scale * rng.uniform(-1, 1, 4)
        yaw, pitch = q[0], q[1:].sum()
        yaw_target, pitch_target = q_target[0], q_target[1:].sum()
        p_target = rng.uniform(-2, 2, 3)
        states.append(
            {
                "q": q,
                "q_target": q_target,
                "p": p_target + scale * rng.uniform(-1, 1, 3) * 0.3,
                "p_target": p_target,
                "r": reference.orientation(yaw, pitch),
                "r_target": reference.orientation(yaw_target, pitch_target),
                "yaw": yaw,
                "pitch": pitch,
                "yaw_target": yaw_target,
                "pitch_target": pitch_target,
                "a": rng.integers(-1, 2, 4),
                "a_previous": rng.integers(-1, 2, 4),
                "inside": bool(rng.integers(2)),
            }
        )
    return [state for state in states if not reference.near_a_threshold(state)]


def test_all_terms_equal_the_reference_on_random_states(paper_reward):
    states = random_states(2000, seed=1)
    assert len(states) > 1900
    batch = {name: np.stack([state[name] for state in states]) for name in states[0]}
    f32 = {name: jnp.asarray(value, jnp.float32) for name, value in batch.items() if name != "inside"}
    d = Deviation(
        position=euclidean_norm(f32["p_target"] - f32["p"]),
        rotation=geodesic_distance(f32["r_target"], f32["r"]),
        yaw=f32["yaw"] - f32["yaw_target"],
        pitch=f32["pitch"] - f32["pitch_target"],
        configuration=f32["q"] - f32["q_target"],
    )
    terms = reward_terms(paper_reward, d, f32["a"], f32["a_previous"], jnp.asarray(batch["inside"]))
    expected = [reference.reward(state) for state in states]
    for term in RewardTerm:
        wanted = np.array([value[term] for value in expected])
        np.testing.assert_allclose(getattr(terms, term), wanted, atol=5e-6, err_msg=str(term))
    # both outcomes of every bonus occur often enough for the comparison to mean something
    counts = np.unique(np.round(terms.precision, 1), return_counts=True)
    assert set(counts[0]) >= {0.0, 0.5, 1.0, 3.0}, counts
    total = np.array([sum(value.values()) for value in expected])
    np.testing.assert_allclose(total_reward(paper_reward, terms), total, atol=1e-5)


# --- which terms are summed

NINE_ROWS = [
    ["pose"],
    ["configuration"],
    ["pose", "precision"],
    ["configuration", "precision"],
    ["pose", "configuration"],
    ["pose", "configuration", "precision"],
    ["pose", "configuration", "precision", "action"],
    ["pose", "configuration", "action", "workspace"],
    ["pose", "configuration", "precision", "action", "workspace"],
]


@pytest.mark.parametrize("terms", NINE_ROWS)
def test_every_row_of_the_ablation_is_a_choice_of_terms(paper_reward, terms):
    config = dataclasses.replace(paper_reward, terms=terms)
    values = RewardTerms(*(jnp.asarray(10.0**index) for index in range(5)))
    expected = sum(10.0 ** list(RewardTerm).index(RewardTerm(term)) for term in terms)
    assert total_reward(config, values) == expected


def test_terms_are_the_fields_of_the_tuple():
    assert RewardTerms._fields == tuple(str(term) for term in RewardTerm)


@pytest.mark.parametrize("change", [{"terms": []}, {"terms": ["pose", "pose"]}, {"position_weight": 0.0}])
def test_bad_configuration_is_named(paper_reward, change):
    with pytest.raises(InputError, match=f"reward.{next(iter(change))}"):
        RewardConfig(**{**vars(paper_reward), **change})
