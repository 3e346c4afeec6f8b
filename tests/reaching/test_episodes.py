import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.machine.poses import satisfies
from pipeline.reaching.episodes import (
    EpisodesConfig,
    evaluation_episodes,
    learning_poses,
    load_episodes,
    save_episodes,
)


@pytest.fixture(scope="module")
def episodes(bobcat, arm, paper_episodes):
    return evaluation_episodes(bobcat, arm, paper_episodes, seed=0, n=200)


def test_starts_and_targets_meet_their_conditions(episodes, bobcat, arm, paper_episodes, forward):
    def meet(conditions, q):
        return jax.jit(lambda q: satisfies(bobcat, arm, conditions, q).all())(q)

    assert episodes.starts.shape == episodes.targets.shape == (200, 4)
    assert meet(paper_episodes.learning_conditions, episodes.starts)
    assert meet(paper_episodes.task_conditions, episodes.targets)
    # by hand, from the paper's numbers
    pitch = np.abs(episodes.targets[:, 1:].sum(axis=1) + np.pi / 2)
    z = np.asarray(forward(jnp.asarray(episodes.targets)).position[:, 2])
    assert pitch.max() <= 0.698 + 1e-5
    assert (z.min() >= 0.155) and (z.max() <= 2.355)
    start_pitch = np.abs(episodes.starts[:, 1:].sum(axis=1) + np.pi / 2)
    assert 0.698 < start_pitch.max() <= 1.047 + 1e-5


def test_the_seed_fixes_them(episodes, bobcat, arm, paper_episodes, tmp_path):
    again = evaluation_episodes(bobcat, arm, paper_episodes, seed=0, n=200)
    np.testing.assert_array_equal(again.starts, episodes.starts)
    np.testing.assert_array_equal(again.targets, episodes.targets)
    assert len(np.unique(np.concatenate([episodes.starts, episodes.targets]), axis=0)) == 400


def test_no_pose_of_an_evaluation_is_in_a_trainings_table(episodes, bobcat, arm, paper_episodes):
    # Seed 0 for both: from one stream, starts would be among the table's second round of candidates.
    table = learning_poses(bobcat, arm, dataclasses.replace(paper_episodes, table_rows=8192), seed=0)
    evaluated = np.concatenate([episodes.starts, episodes.targets])
    assert len(np.unique(np.concatenate([evaluated, table.configurations]), axis=0)) == 400 + 8192


def test_files_come_back_and_are_byte_stable(episodes, tmp_path):
    for name in ("a.npz", "b.npz"):
        save_episodes(tmp_path / name, episodes)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    back = load_episodes(tmp_path / "a.npz")
    np.testing.assert_array_equal(back.starts, episodes.starts)
    np.testing.assert_array_equal(back.first(3).targets, episodes.targets[:3])
    with pytest.raises(InputError, match="-1 episodes are asked for"):
        back.first(-1)


def test_unusable_files_are_named(tmp_path):
    with pytest.raises(InputError, match=r"absent\.npz"):
        load_episodes(tmp_path / "absent.npz")
    (tmp_path / "broken.npz").write_bytes(b"nonsense")
    with pytest.raises(InputError, match=r"broken\.npz"):
        load_episodes(tmp_path / "broken.npz")


@pytest.mark.parametrize(
    "change",
    [
        {"steps": 0},
        {"curve_seed": 1000},
        {"pitch_max_task_rad": 2.0},
        {"z_min_task_m": 3.0},
        {"evaluation_episodes": 0},
    ],
)
def test_bad_configuration_is_named(paper_episodes: EpisodesConfig, change):
    with pytest.raises(InputError, match=f"episodes.{next(iter(change))}"):
        dataclasses.replace(paper_episodes, **change)
