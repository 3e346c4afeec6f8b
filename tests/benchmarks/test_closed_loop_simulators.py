"""The blind benchmark is the same whichever simulator its cases are drawn from."""

from concurrent.futures import Executor

import numpy as np
import pytest

from benchmarks.closed_loop import draw, generate, kinds, visibility
from benchmarks.closed_loop.draw import draw_plan
from benchmarks.closed_loop.folders import Folders
from benchmarks.closed_loop.generate import case_name
from benchmarks.closed_loop.kinematic import working_poses
from benchmarks.closed_loop.machines import variant
from benchmarks.closed_loop.sessions import ingest_settings
from benchmarks.closed_loop.simulators import KINDS, KINEMATIC, MUJOCO, OUTSIDE, SIMULATORS
from benchmarks.closed_loop.solve import tasks
from benchmarks.closed_loop.truth import from_json
from pipeline.logs.trajectories import load_trajectories


@pytest.fixture(autouse=True)
def few_poses(monkeypatch):
    """What effects ask of nominal sessions, they ask of short ones."""
    monkeypatch.setattr(working_poses, "NOMINAL_MINUTES", (1.0, 1.0))


@pytest.fixture
def short(monkeypatch):
    """Sessions of a fifth of a minute."""
    monkeypatch.setattr(draw, "MEASURED_MINUTES", (0.2, 0.2))
    monkeypatch.setattr(draw, "EXAM_MINUTES", 0.2)
    monkeypatch.setattr(draw, "NOMINAL_MINUTES", (0.2, 0.2))
    monkeypatch.setattr(visibility, "N_STRETCH", 3)


def test_simulators_share_no_folder_no_name_and_no_chances():
    assert len({variant(s, 8).name for s in SIMULATORS.values()}) == len(SIMULATORS)
    assert len({variant(s, 8).style_seed for s in SIMULATORS.values()}) == len(SIMULATORS)
    names = {case_name(s, number) for s in SIMULATORS.values() for number in range(9)}
    assert len(names) == 9 * len(SIMULATORS)
    assert not any(kind in name for kind in KINDS for name in names)


@pytest.mark.parametrize("simulator", SIMULATORS.values(), ids=lambda s: s.name)
def test_a_simulator_states_all_that_the_benchmark_asks_for(simulator):
    known = set(kinds.FAMILIES) | set(simulator.outside)
    assert set(simulator.largest_size) == known
    of = variant(simulator, 8)
    for kind in ("delay", "lag", "backlash", "sensor_bias", "timing", *simulator.outside):  # quick ones
        effect = simulator.draw_effect(kind, 3, of, 0.5)
        assert effect.kind == kind
        assert effect.family == ("other" if kind in simulator.outside else kind)
        assert effect.cause and all(quantity.unit for quantity in effect.truth.values())
        assert set(effect.joints) <= set(simulator.specification(of.parameters).joint_names)
        assert effect.apply(of.parameters) is not None


@pytest.mark.parametrize("simulator", SIMULATORS.values(), ids=lambda s: s.name)
def test_a_third_of_the_cases_is_without_effect_and_a_third_outside_the_catalogue(simulator):
    drawn = [kinds.lot(np.random.default_rng(number), number, simulator.outside) for number in range(900)]
    assert sum(kind in kinds.WITHOUT_EFFECT for kind in drawn) == 300
    assert sum(kind in OUTSIDE for kind in drawn) == 300
    assert set(drawn) == set(kinds.in_order(simulator.outside))


@pytest.mark.parametrize("kind", kinds.in_order(KINEMATIC.outside))
def test_every_kind_is_drawn_with_its_truth(kind):
    plan, again = (draw_plan(KINEMATIC, 11, kind) for _ in range(2))
    truth = plan.truth
    assert again.truth == truth == from_json(truth.to_json())
    assert [s.seed for s in plan.measured] == [s.seed for s in again.measured]
    assert draw_plan(KINEMATIC, 12, kind).measured[0].seed != plan.measured[0].seed
    n_effect = {"null": 0, "nominal_range": 0, "pair": 2, "triple": 3}.get(kind, 1)
    assert len(truth.effects) == len(plan.without) == n_effect
    assert len({effect.family for effect in truth.effects}) == n_effect
    assert all(0.0 < e.size <= KINEMATIC.largest_size[e.kind] for e in truth.effects)
    assert len({s.start.date() for s in (*plan.nominal, *plan.measured, *plan.exam)}) == 5
    sound = variant(KINEMATIC, 11).parameters
    is_sound = [s.parameters is sound for s in plan.nominal]
    assert is_sound == {"in_nominal": [False, False], "nominal_range": [True, False]}.get(kind, [True, True])
    assert (plan.measured[-1].style_seed == plan.nominal[0].style_seed) == (truth.style == "same")
    assert kind not in OUTSIDE or truth.effects[0].family == "other"


@pytest.mark.parametrize("kind", ["change_point", "ramp"])
@pytest.mark.parametrize("number", range(8, 12))
def test_what_sets_in_does_so_at_its_onset_and_stays(kind, number):
    plan = draw_plan(KINEMATIC, number, kind)
    [effect] = plan.truth.effects
    assert effect.family == "change_point" and effect.of == effect.kind
    at = [session.name for session in plan.measured].index(effect.onset.trajectory)
    sound = variant(KINEMATIC, number).parameters
    assert all(session.parameters is sound for session in plan.measured[: at + 1])
    assert all(not session.changes for session in (*plan.measured[:at], *plan.measured[at + 1 :], *plan.exam))
    times = [time_s for time_s, _ in plan.measured[at].changes]
    assert times[0] == effect.onset.t and 0.3 * 360 <= effect.onset.t <= 0.7 * 360
    assert len(times) == 1 if kind == "change_point" else np.allclose(np.diff(times), draw.RAMP_STEP_S)


def test_a_ramp_grows_evenly_to_its_size():
    drawn = draw.Drawn(variant(KINEMATIC, 8), "delay", 3, 1.0)
    sound = drawn.variant.parameters

    def added(machine):
        path = machine.quantities.command_path
        return (path.dead_time_s - sound.quantities.command_path.dead_time_s).sum()

    grown = [added(machine) for _, machine in draw._ramp(sound, drawn, 100.0, 360.0)]
    np.testing.assert_allclose(np.diff(grown), grown[0])
    assert grown[-1] == pytest.approx(drawn.at(1.0).truth["added_delay"].value)


def test_a_payload_of_the_nominal_range_lies_between_those_of_nominal_sessions():
    for number in range(8, 12):
        plan = draw_plan(KINEMATIC, number, "nominal_range")
        sessions = (*plan.nominal, plan.measured[0])
        none, most, measured = (s.parameters.quantities.speed.load_loss.sum() for s in sessions)
        assert none == 0.0 < measured <= most


def test_the_visible_size_is_that_of_the_best_search():
    """White noise hides a shift, whose size is known as exactly as the mean of all numbers: z = shift √n."""
    ends = np.random.default_rng(0).normal(size=(1, 2, 2, 20_000, 2))
    ends[:, 0] += 2.0
    acts = np.arange(20_000) % 2 == 0
    squares = visibility.signature_squares(ends, acts[None])[0]
    assert squares == pytest.approx(2.0**2 * 20_000, rel=0.05)
    assert visibility.visible_size(2.0, squares) == pytest.approx(
        2.0 * 4.57 / (2.0 * np.sqrt(20_000)), rel=0.1
    )


def test_an_effect_is_as_visible_as_its_drawn_size_says(short):
    told = [
        visibility.with_visible_sizes(draw_plan(KINEMATIC, 8, kind)).effects[0] for kind in ("gain", "lag")
    ]
    for effect in told:
        assert 0.0 < effect.visible_size < KINEMATIC.largest_size[effect.kind]
        assert effect.is_visible == (effect.size >= effect.visible_size)
    biased = draw_plan(KINEMATIC, 8, "sensor_bias")
    assert visibility.with_visible_sizes(biased).effects[0].visible_size is None


class InProcess(Executor):
    """Workers that are this process, in which parts are replaced."""

    def __init__(self, *_, **__):
        pass

    def map(self, function, *iterables, **_):
        return map(function, *iterables)


def test_cases_are_generated_end_to_end(short, tmp_path, monkeypatch):
    monkeypatch.setattr(generate, "ProcessPoolExecutor", InProcess)
    words = ["generate", str(tmp_path), "--cases", "1", "--first", "8", "--simulator", "kinematic", "mujoco"]
    monkeypatch.setattr("sys.argv", words)
    generate.main()
    folders = Folders(tmp_path)
    assert sorted(folders.complete_cases()) == sorted(case_name(s, 8) for s in (KINEMATIC, MUJOCO))
    for simulator in (KINEMATIC, MUJOCO):
        name = case_name(simulator, 8)
        truth = from_json((folders.seals / f"{name}.json").read_text())
        assert truth.simulator == simulator.name and truth.kind in kinds.FAMILIES
        assert truth.effects[0].visible_size > 0.0
        machine = folders.machine(name)
        assert machine.n_joint == truth.n_joint
        plan = draw_plan(simulator, 8)
        for part, sessions in (("nominal", plan.nominal), ("measured", plan.measured), ("exam", plan.exam)):
            logs = load_trajectories(folders.cases / name / part, machine, *ingest_settings())
            assert len(logs) == len(sessions) and all(len(log.q) > 200 for log in logs)
    told = " ".join(argument for task in tasks(folders, []) for argument in task.arguments)
    assert not any(kind in told for kind in KINDS)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.json")}
    generate.main()
    assert before == {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.json")}
