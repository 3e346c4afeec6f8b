"""The evaluation's tables, parsed back and compared with NumPy's word on the traces, and with the paper's."""

import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.reporting.results.controllers import by_controller, controllers_of, read_controllers, split_name
from pipeline.reporting.results.paper import BRAX_EVALUATION, REWARD_ABLATION, SIMULATED, Published
from pipeline.reporting.tables.counts import smaller_budget
from pipeline.reporting.tables.differences import Circumstances, difference_sentences, is_large
from pipeline.reporting.tables.evaluation import brax_evaluation_table, comparison_table, differences
from tests.reporting.made_up import N_EPISODES, random_traces, write_controller

SEEDS = (0, 1, 2)
PLANNING = {"samples": 64, "iterations": 4, "horizon_entries": 8, "ticks_per_entry": 4}
CELLS = {
    "models": ["mlp"],
    "targets": ["dqdot"],
    "seeds": SEEDS,
    "icem_variants": ["icem_dagger"],
    "icem_models": ["mlp"],
    "icem_targets": ["dqdot"],
    "icem_seeds": [0],
}
NUMBER = re.compile(r"(-?\d+\.\d\d) ± (\d+\.\d\d)")


def test_planners_are_those_of_their_own_models_and_targets():
    cells = CELLS | {"models": ["mlp", "kan"], "targets": ["dq", "dqdot"]}
    assert controllers_of(cells) == {
        "icem_dagger_mlp_dqdot": [0],
        **{
            f"{algorithm}_{kind}": [*SEEDS]
            for algorithm in ("apg", "ppo_warm")
            for kind in ("mlp_dq", "mlp_dqdot", "kan_dq", "kan_dqdot")
        },
    }
    planless = {"models": ["kan"], "targets": ["dq"], "seeds": [1]}
    assert controllers_of(planless) == {"apg_kan_dq": [1], "ppo_warm_kan_dq": [1]}


@pytest.fixture(scope="module")
def made_up(tmp_path_factory):
    """A policy with three seeds, a planner with one; and their traces."""
    artifacts = tmp_path_factory.mktemp("artifacts")
    traces = {seed: random_traces(seed) for seed in SEEDS}
    for seed, of_seed in traces.items():
        write_controller(artifacts, "ppo_mlp_dqdot", seed, of_seed, {"steps": 32_000_000})
    write_controller(artifacts, "icem_dagger_mlp_dqdot", 0, random_traces(7), PLANNING)
    return artifacts, traces


@pytest.fixture(scope="module")
def controllers(made_up):
    return read_controllers(made_up[0], {"ppo_mlp_dqdot": SEEDS, "icem_dagger_mlp_dqdot": [0]})


def recomputed(traces) -> list[float]:
    """The six metrics of the table by their definitions, episode by episode, in plain float64."""
    n = len(traces.reward)
    returns = np.mean([np.sum(rewards.astype(float)) for rewards in traces.reward])

    def rate(threshold: float) -> float:
        hits = 0
        for distance, pitch in zip(traces.position_error, traces.pitch_error, strict=True):
            hits += any(
                d < threshold and -threshold < p < threshold for d, p in zip(distance, pitch, strict=True)
            )
        return hits / n

    outside = sum(not all(inside) for inside in traces.inside) / n
    below = sum(any(below) for below in traces.below) / n
    return [returns, rate(0.02), rate(0.04), outside, below, float(traces.position[:, :, 2].min())]


def expected(traces) -> list[tuple[float, float]]:
    values = np.array([recomputed(traces[seed]) for seed in SEEDS])
    return list(zip(values.mean(axis=0), values.std(axis=0, ddof=1), strict=True))


def figures(line: str) -> list[tuple[float, float]]:
    plain = line.replace(r"$\pm$", "±").replace("$-$", "-")
    return [(float(mean), float(deviation)) for mean, deviation in NUMBER.findall(plain)]


def test_the_papers_table_parsed_back_is_numpys_word_on_the_traces(made_up, controllers):
    table = brax_evaluation_table(controllers, SIMULATED)
    truth = expected(made_up[1])
    in_markdown = next(line for line in table.markdown().splitlines() if "MLP Δq̇" in line)
    in_latex = next(line for line in table.latex().splitlines() if r"MLP $\Delta\dot{\bm{q}}$ &" in line)
    for line in (in_markdown, in_latex):
        np.testing.assert_allclose(figures(line), truth, atol=0.00501)


def test_it_has_the_papers_rows_columns_and_counts(controllers):
    table = brax_evaluation_table(controllers, SIMULATED)
    assert [tuple(row[:2]) for row in table.rows] == [
        ("PPO", "MLP Δq"),
        ("PPO", "MLP Δq̇"),
        ("PPO", "KAN Δq"),
        ("PPO", "KAN Δq̇"),
        ("iCEM", "MLP Δq̇"),
        ("iCEM†", "MLP Δq̇"),
        ("iCEM‡", "MLP Δq̇"),
    ]
    assert table.columns[2:] == [
        "Avg. return",
        "SR(0.02, 0.02)",
        "SR(0.04, 0.04)",
        "OOW",
        "OOZ",
        "Min. z [m]",
    ]
    assert table.rules == [4]
    assert all(cell == "–" for cell in table.rows[0][2:])  # was not run
    counts = table.notes[0]
    assert f"PPO MLP Δq̇: 3 seeds, {N_EPISODES} episodes each, 32 M steps" in counts
    assert (
        f"iCEM† MLP Δq̇: 1 seed, {N_EPISODES} episodes each, 64 samples × 4 iterations × 8 entries of 4 ticks"
        in counts
    )
    assert "Not run: PPO MLP Δq, PPO KAN Δq" in counts


def test_the_papers_figures_stand_below_ours(made_up, controllers):
    lines = comparison_table(controllers, SIMULATED).markdown().splitlines()[4:]
    ours, papers = lines[0], lines[1]
    np.testing.assert_allclose(figures(ours)[:6], expected(made_up[1]), atol=0.00501)
    assert figures(papers) == [tuple(figure) for figure in BRAX_EVALUATION["ppo_mlp_dqdot"].values()]
    assert papers.rstrip(" |").endswith("5 | 500 | 270 M steps")
    way = np.mean(
        [
            sum(np.linalg.norm(b - a) for a, b in pairwise(path))
            for traces in made_up[1].values()
            for path in map(until_reached, *paths(traces))
        ]
    )
    assert figures(ours)[-1][0] == pytest.approx(way, abs=0.00501)


def paths(traces):
    points = np.concatenate([traces.start_position[:, None], traces.position], axis=1).astype(float)
    return points, (traces.position_error < 0.02) & (abs(traces.pitch_error) < 0.02)


def until_reached(points, reached):
    return points[: 2 + np.flatnonzero(reached)[0]] if reached.any() else points


def test_seeds_of_an_earlier_run_are_not_read(made_up):
    read = read_controllers(made_up[0], {"ppo_mlp_dqdot": [0, 2]})
    assert [(c.name, c.seed) for c in read] == [
        ("ppo_mlp_dqdot", 0),
        ("ppo_mlp_dqdot", 2),
        ("icem_dagger_mlp_dqdot", 0),  # found, though nothing asks for it
    ]
    with pytest.raises(InputError, match=r"seed_5.*run the stage"):
        read_controllers(made_up[0], {"ppo_mlp_dqdot": [5]})


def test_names_of_folders():
    assert split_name("icem_double_dagger_kan_dqdot") == ("icem_double_dagger", "kan_dqdot")
    assert split_name("ppo_mlp_dq") == ("ppo", "mlp_dq")
    with pytest.raises(InputError, match="no controller"):
        split_name("ppo_forest_dq")


def test_published_tables_agree_where_the_paper_repeats_itself():
    full = REWARD_ABLATION["X+q+ε+a+W"]
    assert {metric: full[metric] for metric in BRAX_EVALUATION["ppo_mlp_dqdot"]} == BRAX_EVALUATION[
        "ppo_mlp_dqdot"
    ]
    assert len(REWARD_ABLATION) == 9 and all(len(row) == 7 for row in REWARD_ABLATION.values())


@pytest.mark.parametrize(
    ("values", "published", "large"),
    [
        ([0.36, 0.40, 0.32], Published(0.99, 0.01), True),
        ([0.97, 0.99], Published(0.99, 0.01), False),  # 0.01: nobody notices
        ([0.2, 0.9], Published(0.99, 0.01), False),  # far, but so are the seeds from one another
        ([0.36], Published(0.99, 0.01), True),  # one seed has no scatter
    ],
)
def test_a_difference_is_large_beyond_scatter_and_notice(values, published, large):
    assert is_large("sr_002_002", values, published) is large


def test_a_difference_says_how_much_and_why_that_may_be():
    circumstances = Circumstances("32 M steps of training instead of 270 M steps", "simulated")
    ours = {"sr_002_002": [0.36], "path_length_m": [1.0], "ooz": [0.5]}
    published = {
        "sr_002_002": Published(0.99, 0.01),
        "path_length_m": Published(2.0, 0.1),
        "ooz": Published(0.1, 0.0),
    }
    precision, way, below = difference_sentences("PPO", ours, published, circumstances)
    assert "ours is 0.36, lower than the paper's 0.99 by 0.63" in precision and "270 M steps" in precision
    assert "lower than the paper's 2.00 by 1.00" in way and "270 M steps" in way
    assert "ooz" not in below and "OOZ" in below and "simulated" in below and "270 M" not in below


def test_every_sentence_is_of_a_controller_that_ran(controllers):
    sentences = differences(controllers, SIMULATED)
    titles = {group[0].title for group in by_controller(controllers).values()}
    assert sentences and all(sentence.split(",")[0] in titles for sentence in sentences)


def test_budgets(controllers):
    groups = by_controller(controllers)
    assert smaller_budget(groups["ppo_mlp_dqdot"]).startswith("32 M steps of training instead of 270 M steps")
    assert "64 samples" in smaller_budget(groups["icem_dagger_mlp_dqdot"])
    (first, *_) = groups["ppo_mlp_dqdot"]
    for name in ("apg", "ppo_warm"):  # of which the paper has no row
        for kind in ("mlp_dqdot", "nfir_dqdot"):
            assert "training" not in smaller_budget([replace(first, algorithm=name, kind=kind)])
