"""The reward ablation: which trainings, what counts as finished, that an interrupted one goes on."""

import dataclasses
import json

import pytest

from pipeline.configuration.load import load_section
from pipeline.control import reward_ablation
from pipeline.control.reward_ablation import (
    Ablation,
    AblationCell,
    CellResult,
    RewardAblationConfig,
    cells,
    finished,
    load_cell,
    save_cell,
)
from pipeline.control.training import TrainingResult
from pipeline.errors import InputError
from pipeline.reaching.reward import RewardTerm
from pipeline.reaching.settings import ReachingSettings
from pipeline.reporting.chapters.reward_ablation import (
    PAPER_KIND,
    ablation_beside_paper,
    ablation_differences,
    ablation_page,
    ablation_table,
    precision_sentence,
    superscripts,
)
from pipeline.reporting.results.paper import METRIC_COLUMNS, REWARD_ABLATION, SIMULATED

POSE, BONUS = RewardTerm.pose, RewardTerm.precision
CONFIG = {
    "rows": [["pose"], ["pose", "precision"]],
    "seeds": [3, 5],
    "training_steps": 9,
    "evaluated_at_steps": 8,
}


@pytest.fixture(scope="module")
def config() -> RewardAblationConfig:
    return RewardAblationConfig(**CONFIG)


@pytest.fixture
def ablation(task, bobcat, arm, paper_episodes, paper_reward, paper_ppo) -> Ablation:
    episodes = dataclasses.replace(paper_episodes, table_rows=64, evaluation_episodes=4)
    ppo = dataclasses.replace(paper_ppo, curve_episodes=2)
    reaching = ReachingSettings(bobcat, arm, paper_reward, episodes, 4)
    return Ablation(reaching, task.dynamics, task.parameters, "model", ppo)


def result(rate: float) -> CellResult:
    return CellResult(8, {"n_episodes": 500, **dict.fromkeys(METRIC_COLUMNS, rate)})


def test_every_row_gets_its_first_seed_before_any_its_second(config):
    assert list(cells(config)) == [
        AblationCell((POSE,), 3),
        AblationCell((POSE, BONUS), 3),
        AblationCell((POSE,), 5),
        AblationCell((POSE, BONUS), 5),
    ]


@pytest.mark.parametrize("profile", ["paper", "default", "smoke"])
def test_the_profiles_have_the_papers_nine_rows_in_its_order(profile):
    rows = load_section("reward_ablation", RewardAblationConfig, profile).rows
    assert [superscripts(row) for row in rows] == list(REWARD_ABLATION)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"rows": [["pose"], []]}, "rows"),
        ({"rows": [["pose", "action"], ["action", "pose"]]}, "rows"),
        ({"rows": [["posture"]]}, "rows has posture"),
        ({"seeds": [1, 1]}, "seeds"),
        ({"evaluated_at_steps": 10}, "evaluated_at_steps"),
    ],
)
def test_bad_configuration_is_named(change, said):
    with pytest.raises(InputError, match=f"reward_ablation.{said}"):
        RewardAblationConfig(**{**CONFIG, **change})


def test_a_finished_cell_is_kept_until_what_it_depends_on_changes(ablation, config, tmp_path):
    cell = AblationCell((POSE,), 3)
    save_cell(tmp_path, cell, ablation.identity(cell), result(0.5))
    assert load_cell(tmp_path, cell, ablation.identity(cell)) == result(0.5)
    assert load_cell(tmp_path, AblationCell((POSE,), 5), ablation.identity(cell)) is None
    dearer = dataclasses.replace(ablation.reaching.reward, position_weight=2.0)
    for change in (
        {"fingerprint": "other"},
        {"ppo": dataclasses.replace(ablation.ppo, discount=0.9)},
        {"reaching": dataclasses.replace(ablation.reaching, reward=dearer)},
        {"reaching": dataclasses.replace(ablation.reaching, action_repeats=2)},
    ):
        assert load_cell(tmp_path, cell, dataclasses.replace(ablation, **change).identity(cell)) is None
    rows = finished(tmp_path, config, ablation.identity)
    assert rows == {(POSE,): [result(0.5)], (POSE, BONUS): []}
    (tmp_path / f"{cell.name}.json").write_text("{")
    with pytest.raises(InputError, match="delete it"):
        load_cell(tmp_path, cell, "any")


def test_a_cell_is_trained_and_judged_with_its_own_terms(ablation, monkeypatch):
    """Brax's training is replaced by nothing: the policy stays as it is initialised."""
    given = {}

    def train(environment, config, seed, episodes, progress, checkpoints):
        given.update(environment=environment, seed=seed, episodes=episodes)
        return TrainingResult(idle_policy(environment.observation_size, 4), 8, [])

    monkeypatch.setattr(reward_ablation, "train", train)
    outcome = ablation.run(AblationCell((RewardTerm.action,), 3), lambda point: None, None)
    assert given["environment"].task.reward.terms == [RewardTerm.action]
    assert given["seed"] == 3 and len(given["episodes"].starts) == 2
    assert outcome.metrics["n_episodes"] == 4
    assert outcome.metrics["average_return"] == 0.0  # a policy that never commands pays nothing for commands


def idle_policy(n_observation: int, n_joint: int):
    import jax.numpy as jnp

    from pipeline.control.policy import Policy, PolicyLayer

    layer = PolicyLayer(jnp.zeros((n_observation, 2 * n_joint)), jnp.zeros(2 * n_joint))
    return Policy(jnp.zeros(n_observation), jnp.ones(n_observation), (layer,))


def test_tables_have_the_papers_rows_and_say_what_is_missing():
    rows = {tuple(terms_of(row)): [] for row in REWARD_ABLATION}
    rows[POSE, BONUS] = [result(0.5), result(0.7)]
    rows[(POSE,)] = [result(0.1)]
    table = ablation_table(rows, PAPER_KIND, SIMULATED)
    assert [row[0] for row in table.rows][:3] == ["r^X", "r^q", "r^X + r^ε"]
    assert len(table.rows) == 9 and table.rows[1][1:] == ["–"] * 7
    assert table.rows[2][1:] == ["0.60 ± 0.14"] * 7  # 0.1 sqrt 2
    assert table.notes[0].startswith("0 to 2 seeds per row, 500 episodes each")
    lines = ablation_beside_paper(rows, PAPER_KIND, SIMULATED).latex().splitlines()
    ours = next(i for i, line in enumerate(lines) if r"$r_t^{\mathcal{X}}$ + $r_t^{\epsilon}$" in line)
    assert "842.83" in lines[ours + 1] and " 5 & 500 & 270 M steps" in lines[ours + 1]
    assert json.loads(table.json())["rows"][0]["EEF-PL [m]"] == "0.10"
    assert "60 % of the episodes" in precision_sentence(rows) and "10 %" in precision_sentence(rows)
    differences = ablation_differences(rows, PAPER_KIND, SIMULATED)
    assert any(sentence.startswith("r^X + r^ε, SR(0.02, 0.02)") for sentence in differences)
    of_another_kind = ablation_beside_paper(rows, "kan_dqdot", SIMULATED)
    assert {row[1] for row in of_another_kind.rows} == {"ours"}  # the paper has no ablation of it
    assert ablation_differences(rows, "kan_dqdot", SIMULATED) == []
    page = ablation_page(rows, PAPER_KIND, SIMULATED, [])
    assert "<li>r<sup>X</sup> + r<sup>ε</sup>, SR" in page and "r^" not in page


def terms_of(marks: str) -> list[RewardTerm]:
    return [term for term in RewardTerm if superscripts([term]) in marks.split("+")]
