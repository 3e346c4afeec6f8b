import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.errors import InputError
from pipeline.machine.poses import PoseConditions, build_pose_table, sample_configurations
from pipeline.machine.specification import WorkspaceSpecification
from pipeline.machine.workspace import below_lower_plane, contains
from tests.machine.reference import chisel_transform

LEARNING = PoseConditions(pitch_max_rad=1.047, z_min_m=None, z_max_m=None)
TASK = PoseConditions(pitch_max_rad=0.698, z_min_m=0.155, z_max_m=2.355)


def in_workspace(q: np.ndarray) -> bool:
    """The contract's W+ in plain words, for one configuration."""
    x, y, z = chisel_transform(q)[:3, 3]
    return 0.9 <= np.hypot(x, y) <= 2.6 and abs(np.arctan2(y, x)) <= 0.85 and 0.155 <= z <= 2.5


@pytest.fixture(scope="session")
def tables(bobcat, arm):
    return {
        name: build_pose_table(jax.random.key(0), bobcat, arm, conditions, 2048)
        for name, conditions in (("learning", LEARNING), ("task", TASK))
    }


def test_workspace_bounds(bobcat):
    position = jnp.array(
        [
            [1.5, 0.0, 1.0],  # inside
            [0.89, 0.0, 1.0],  # too near
            [2.61, 0.0, 1.0],  # too far
            [1.5, 0.0, 0.15],  # below
            [1.5, 0.0, 2.51],  # above
            [1.5 * np.cos(0.86), 1.5 * np.sin(0.86), 1.0],  # too far to the left
            [-1.5, 0.0, 1.0],  # behind the swing axis, at zero swing
            [1.5, 0.0, 0.155],  # on the grill
        ]
    )
    yaw = jnp.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.86, 0.0, 0.0])
    assert contains(bobcat.workspace, position, yaw).tolist() == [True] + 6 * [False] + [True]
    assert below_lower_plane(bobcat.workspace, position).tolist() == [False] * 3 + [True] + 4 * [False]


@given(seed=st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=20)
def test_contains_agrees_with_the_contract_on_any_configuration(bobcat, arm, forward, seed):
    q = np.random.default_rng(seed).uniform(bobcat.lower, bobcat.upper, (64, 4))
    position = forward(jnp.asarray(q, jnp.float32)).position
    found = contains(bobcat.workspace, position, jnp.asarray(q[:, 0]))
    assert found.tolist() == [in_workspace(configuration) for configuration in q]
    assert not np.any(found & below_lower_plane(bobcat.workspace, position))


@pytest.mark.parametrize(("name", "pitch_max", "z_max"), [("learning", 1.047, 2.5), ("task", 0.698, 2.355)])
def test_every_pose_of_a_table_satisfies_its_conditions(bobcat, tables, name, pitch_max, z_max):
    table = tables[name]
    q = np.asarray(table.configurations, np.float64)
    tips = np.array([chisel_transform(configuration)[:3, 3] for configuration in q])
    slack = 1e-5  # float32
    assert ((q >= bobcat.lower - slack) & (q <= bobcat.upper + slack)).all()
    assert (np.abs(q[:, 1:].sum(axis=1) + np.pi / 2) <= pitch_max + slack).all()
    radius = np.hypot(tips[:, 0], tips[:, 1])
    assert ((radius >= 0.9 - slack) & (radius <= 2.6 + slack)).all()
    assert (np.abs(q[:, 0]) <= 0.85 + slack).all() and (tips[:, 0] > 0).all()
    assert ((tips[:, 2] >= 0.155 - slack) & (tips[:, 2] <= z_max + slack)).all()
    assert np.abs(tips - table.positions).max() < slack


def test_distribution_and_acceptance_rate_are_those_of_plain_rejection(bobcat, tables):
    """Against an independent NumPy rejection sampler: acceptance rate and joint quantiles."""
    q = np.random.default_rng(1).uniform(bobcat.lower, bobcat.upper, (20_000, 4))
    kept = q[[in_workspace(c) and abs(c[1:].sum() + np.pi / 2) <= 1.047 for c in q]]
    rate = len(kept) / len(q)
    assert abs(tables["learning"].acceptance_rate - rate) < 4 * np.sqrt(2 * rate / len(q))
    levels = [0.1, 0.5, 0.9]
    difference = np.quantile(kept, levels, axis=0) - np.quantile(
        tables["learning"].configurations, levels, axis=0
    )
    assert np.abs(difference).max() < 0.08


def test_sampling_is_a_function_of_the_key(bobcat, arm, tables):
    table = np.asarray(tables["learning"].configurations)  # of key 0
    again, other = (
        sample_configurations(jax.random.key(seed), bobcat, arm, LEARNING, 2048) for seed in (0, 1)
    )
    assert np.array_equal(again, table)
    assert not np.array_equal(other, table)
    assert len(np.unique(table, axis=0)) == 2048


def test_draw_inside_jit_and_vmap_gives_rows_with_their_pose(tables, forward):
    table = tables["task"]
    q, pose = jax.jit(jax.vmap(table.draw))(jax.random.split(jax.random.key(5), 256))
    rows = {row.tobytes() for row in np.asarray(table.configurations)}
    assert all(row.tobytes() in rows for row in np.asarray(q))
    assert np.abs(forward(q).position - pose.position).max() < 1e-6
    assert len(np.unique(np.asarray(q), axis=0)) > 200


def test_impossible_conditions_are_an_input_error(bobcat, arm):
    with pytest.raises(InputError, match=r"0 of .* widen the conditions"):
        sample_configurations(jax.random.key(0), bobcat, arm, PoseConditions(0.1, 2.45, 2.46), 8)
    with pytest.raises(InputError, match="pitch_max_rad"):
        PoseConditions(0.0, None, None)
    with pytest.raises(InputError, match="z_min_m"):
        PoseConditions(1.0, 2.0, 1.0)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ((2.6, 0.9, 0.85, 0.155, 2.5, 0.155), "radius_min_m"),
        ((0.9, 2.6, 4.0, 0.155, 2.5, 0.155), "yaw_max_rad"),
        ((0.9, 2.6, 0.85, 2.5, 0.155, 0.155), "z_min_m"),
    ],
)
def test_impossible_workspaces_are_refused(values, message):
    with pytest.raises(InputError, match=message):
        WorkspaceSpecification(*values)
