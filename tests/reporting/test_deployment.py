"""Tables, figures and sentences of deployment, from made-up artifacts and the paper's printed figures."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from pipeline.configuration.load import load_machine
from pipeline.control.icem.variant import RewardVariant
from pipeline.machine.chain import GROUND
from pipeline.reaching.metrics import Traces, reaching_metrics, success_rate_matrix
from pipeline.reporting.chapters.deployment import (
    deployment_figures,
    deployment_section,
    deployment_tables,
)
from pipeline.reporting.results.controllers import TRAINED, read_controllers, split_name
from pipeline.reporting.results.deployments import Where, files_of, read_deployments
from pipeline.reporting.results.paper import SIM2REAL, SIM2SIM, SIMULATED
from pipeline.reporting.tables.deployment import transfers
from tests.reporting.made_up import N_EPISODES, random_traces, write_controller
from tests.stages.command import run_stage

N_TARGETS, N_PLANNED = 5, 4
PPO, ICEM = "ppo_mlp_dqdot", "icem_double_dagger_mlp_dqdot"


def first(traces: Traces, n: int) -> Traces:
    return Traces(*(values[:n] for values in traces))


def write_deployment(artifacts, name: str, graph: Traces, plant: Traces | None) -> None:
    folder = artifacts / "sim2sim" / name
    folder.mkdir(parents=True)
    (folder / "metrics.json").write_text(json.dumps(reaching_metrics(graph, GROUND).as_dict()))
    np.savez(folder / "traces.npz", **graph._asdict())
    if plant is None:
        return
    (artifacts / "evaluate_logs" / name).mkdir(parents=True)
    reaching = reaching_metrics(plant, GROUND).as_dict() | {
        "success_rates": {"matrix": success_rate_matrix(plant).tolist()}
    }
    seen = {"median": 0.02, "p99": 0.03, "p999": 0.04, "maximum": 0.05, "n": 100}
    content = {
        "open_loop_rmse_80": {"swing": 0.01, "boom": 0.02, "arm": 0.09, "bucket": 0.01},
        "reaching": reaching,
        "delays": {"decision_age_s": seen},
        "safety": {"emergency_stops": 0},
    }
    (artifacts / "evaluate_logs" / name / "time_out.json").write_text(json.dumps(content))
    goals = [{"goal": n, "outcome": "reached" if n else "timed_out", "ticks": 100 + 20 * n} for n in range(5)]
    (artifacts / "sim2real" / name / "goal").mkdir(parents=True)
    (artifacts / "sim2real" / name / "goal/goals.json").write_text(json.dumps({"goals": goals}))


@pytest.fixture(scope="module")
def made_up(tmp_path_factory):
    """A policy that was evaluated in Brax and drove everywhere; a planner that drove the graph alone."""
    artifacts = tmp_path_factory.mktemp("artifacts")
    traces = {
        Where.brax: random_traces(0),
        Where.graph: random_traces(1),
        Where.plant: first(random_traces(2), N_TARGETS),
    }
    for seed in (0, 1):
        write_controller(artifacts, PPO, seed, random_traces(seed), {"steps": 1})
    write_deployment(artifacts, PPO, traces[Where.graph], traces[Where.plant])
    write_deployment(artifacts, ICEM, first(random_traces(5), N_PLANNED), None)
    controllers = read_controllers(artifacts, {PPO: [0, 1]})
    return read_deployments(artifacts, controllers), traces


def cells(table, *labels: str) -> list[str]:
    (row,) = (row for row in table.rows if tuple(row[:4]) == labels)
    return list(row[4:])


def by_hand(traces: Traces) -> list[str]:
    """The five figures by their definitions, episode by episode."""
    n = len(traces.q)

    def rate(metres: float, radians: float) -> float:
        hits = [
            any(d < metres and abs(p) < radians for d, p in zip(*errors, strict=True))
            for errors in zip(traces.position_error.tolist(), traces.pitch_error.tolist(), strict=True)
        ]
        return sum(hits) / n

    left = sum(not inside.all() for inside in traces.inside) / n
    below = sum(bool(low.any()) for low in traces.below) / n
    lowest = min(float(z) for z in traces.position[..., 2].ravel())
    return [
        f"{rate(0.02, 0.02):.2f}",
        f"{rate(0.12, 0.08):.2f}",
        f"{left:.3f}",
        f"{below:.3f}",
        f"{lowest:.3f}",
        str(n),
    ]


def test_the_tables_hold_our_figures_over_the_same_trials_and_the_paper_s(made_up) -> None:
    deployments, traces = made_up
    tables = deployment_tables(load_machine("bobcat_e10"), deployments, SIMULATED)
    sim2sim, sim2real = tables["sim2sim"], tables["sim2real"]
    assert cells(sim2sim, "Brax", "PPO", "MLP Δq̇", "ours") == by_hand(traces[Where.brax])
    assert cells(sim2sim, "Graph", "PPO", "MLP Δq̇", "ours") == by_hand(traces[Where.graph])
    assert cells(sim2sim, "Graph", "iCEM‡", "MLP Δq̇", "ours")[-1] == str(N_PLANNED)
    assert cells(sim2sim, "Graph", "PPO", "MLP Δq̇", "paper") == [
        "0.11",
        "1.00",
        "0.118",
        "0.068",
        "0.000",
        "500",
    ]
    assert cells(sim2real, "Plant", "PPO", "MLP Δq̇", "ours") == by_hand(traces[Where.plant])
    assert cells(sim2real, "Graph", "PPO", "MLP Δq̇", "ours") == by_hand(first(traces[Where.graph], N_TARGETS))
    assert cells(sim2real, "Plant", "PPO", "MLP Δq̇", "paper") == [
        "0.02",
        "0.99",
        "0.070",
        "0.040",
        "0.050",
        "100",
    ]
    assert not any(row[1] == "iCEM‡" for row in sim2real.rows)
    assert any("Not run: PPO MLP Δq, PPO KAN Δq." in note for note in sim2sim.notes)
    for table in tables.values():
        assert table.markdown() and r"\begin{table}" in table.latex() and json.loads(table.json())["rows"]


def test_the_table_of_a_run_in_the_field_stands_beside_the_workshop_s(made_up, tmp_path) -> None:
    machine, deployments = load_machine("bobcat_e10"), made_up[0]
    tables = deployment_tables(machine, deployments, SIMULATED)
    tables["sim2real"].write(tmp_path, "sim2real")
    in_field = json.loads((tmp_path / "sim2real.json").read_text())
    section = deployment_section(machine, deployments, {}, SIMULATED, in_field)
    workshop, *_, field = (table.markdown().splitlines() for table in (tables["sim2real"], *section.tables))
    assert field[1:] == workshop[1:]
    assert field[0].endswith("on the plant, in the field**")


def test_goals_and_delays_are_counted(made_up) -> None:
    tables = deployment_tables(load_machine("bobcat_e10"), made_up[0], SIMULATED)
    assert list(tables["until_goal"].rows[0]) == ["PPO", "MLP Δq̇", "5", "4", "7.5", "9.0"]
    assert list(tables["delays"].rows[0][3:]) == ["20.0", "30.0", "50.0", "100"]


def test_the_chapter_says_what_the_transfer_costs(made_up) -> None:
    deployments, traces = made_up
    figures = deployment_figures(deployments)
    assert list(figures) == ["sim2sim_success_rates", "sim2real_success_rates"]
    section = deployment_section(load_machine("bobcat_e10"), deployments, figures, SIMULATED)
    assert len(section.figures) == 2 and len(section.tables) == 3 and len(section.folded_tables) == 1
    (points,) = section.points
    assert len(points.sentences) == 2  # of the policy alone: the planner was not evaluated in Brax
    before, after = (by_hand(traces[place])[0] for place in (Where.brax, Where.graph))
    assert f"SR(0.02, 0.02) from {before} to {after}" in points.sentences[0]
    assert points.sentences[0].endswith("in the paper 0.98 to 0.11, 1.00 to 1.00.")
    assert f"({N_EPISODES} trials)" in points.sentences[0]
    assert "worst joint relative to its range (arm) is off by 0.090 rad" in section.paragraphs[0]


def test_one_sentence_per_controller_says_what_became_of_it(made_up) -> None:
    deployments, traces = made_up
    policy, planner = transfers(deployments)
    graph, plant = (reaching_metrics(traces[where], GROUND).as_dict() for where in (Where.graph, Where.plant))
    paper = [SIM2SIM["Gazebo"][PPO]["sr_002_002"], SIM2REAL["Machine"][PPO]["sr_002_002"]]
    assert policy == (
        f"PPO MLP Δq̇ comes within 0.12 m and 0.08 rad of {100 * graph['sr_012_008']:.0f} % of {N_EPISODES} targets "
        f"through the graph with its delays and {100 * plant['sr_012_008']:.0f} % of {N_TARGETS} targets on the plant, "
        f"within 0.02 m and 0.02 rad of {100 * graph['sr_002_002']:.0f} % and {100 * plant['sr_002_002']:.0f} % "
        f"(the paper's: {100 * paper[0]:.0f} % and {100 * paper[1]:.0f} %)."
    )
    assert f"of {N_PLANNED} targets through the graph" in planner and "plant" not in planner


def test_the_paper_s_figures_are_rates_of_so_many_trials() -> None:
    """Every printed rate is a whole number of episodes, to its last digit; a slip of the pen would not be."""
    for tables, n in ((SIM2SIM, 500), (SIM2REAL, 100)):
        for rows in tables.values():
            assert list(rows) == list(SIM2SIM["Brax"])
            for figures in rows.values():
                for metric in ("oow", "ooz"):
                    assert figures[metric] * n == pytest.approx(round(figures[metric] * n))
                assert figures["sr_002_002"] <= figures["sr_012_008"] and figures["ooz"] <= figures["oow"]


def test_what_is_deployed_is_named_after_its_model_and_is_among_those_that_are_made() -> None:
    parameters = yaml.safe_load((Path(__file__).parents[2] / "params.yaml").read_text())
    made = {f"{model}_{target}" for model in parameters["models"] for target in parameters["targets"]}
    for name, deployed in parameters["deployed"].items():
        algorithm, kind = split_name(name)
        assert deployed["model"] == kind and kind in made
        policy = f"artifacts/{algorithm}/{kind}/seed_{parameters['seeds'][0]}"
        if algorithm in TRAINED:
            assert (deployed["controller"], deployed["from"]) == (f"policy={policy}", policy)
        else:
            assert deployed["controller"] == f"variant={algorithm}" in map("variant={}".format, RewardVariant)


def test_artifacts_without_deployments_have_none(tmp_path) -> None:
    assert read_deployments(tmp_path, []) == []


def test_metrics_that_an_earlier_run_left_under_git_are_no_deployment(tmp_path) -> None:
    write_deployment(tmp_path, PPO, random_traces(1), None)
    (tmp_path / "sim2sim" / PPO / "traces.npz").unlink()
    write_controller(tmp_path, PPO, 0, random_traces(0), {"steps": 1})
    (tmp_path / "evaluate_brax" / PPO / "seed_0" / "traces.npz").unlink()
    assert read_deployments(tmp_path, []) == [] == read_controllers(tmp_path, {})


def test_the_table_of_sim2real_comes_from_its_own_stage(tmp_path) -> None:
    refused = run_stage("sim2real_table", "artifacts=.", "output=tables", folder=tmp_path)
    assert refused.returncode == 2 and "run sim2sim and sim2real first" in refused.stderr
    graph, plant = random_traces(1), first(random_traces(2), N_TARGETS)
    write_deployment(tmp_path, PPO, graph, plant)
    assert run_stage("sim2real_table", "artifacts=.", "output=tables", folder=tmp_path).returncode == 0
    told = [list(row.values()) for row in json.loads((tmp_path / "tables/sim2real.json").read_text())["rows"]]
    ours = [row[4:] for row in told if row[3] == "ours"]
    assert ours == [by_hand(first(graph, N_TARGETS)), by_hand(plant)]


def test_what_was_read_is_named_where_it_is(tmp_path) -> None:
    write_controller(tmp_path, PPO, 0, random_traces(0), {"steps": 1})
    write_deployment(tmp_path, PPO, random_traces(1), first(random_traces(2), N_TARGETS))
    write_deployment(tmp_path, ICEM, first(random_traces(5), N_PLANNED), None)
    controllers = read_controllers(tmp_path, {PPO: [0]})
    named = files_of(tmp_path, controllers, read_deployments(tmp_path, controllers))
    assert {path.relative_to(tmp_path).as_posix() for path in named} == {
        f"evaluate_brax/{PPO}/seed_0/traces.npz",
        f"sim2sim/{PPO}/traces.npz",
        f"sim2real/{PPO}",
        f"sim2sim/{ICEM}/traces.npz",
    }
