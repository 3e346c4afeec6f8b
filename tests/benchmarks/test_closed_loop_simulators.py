"""The blind benchmark is the same whichever simulator its cases are drawn from."""

import hashlib
import json
from concurrent.futures import Executor
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from benchmarks.closed_loop import generate, kinds, ledger
from benchmarks.closed_loop.calibration import Calibration
from benchmarks.closed_loop.comparison import Solution
from benchmarks.closed_loop.draw import draw_case, draw_plan, plain
from benchmarks.closed_loop.folders import CASE_FILE, Folders
from benchmarks.closed_loop.generate import case_name
from benchmarks.closed_loop.ledger import Record
from benchmarks.closed_loop.machines import N_VARIANT, variant, variant_name
from benchmarks.closed_loop.score import main as score
from benchmarks.closed_loop.sessions import ingest_settings, machine
from benchmarks.closed_loop.simulators import KINDS, KINEMATIC, OUTSIDE, PLANT, SIMULATORS
from benchmarks.closed_loop.solve import tasks
from benchmarks.closed_loop.truth import Truth, from_content, from_json
from pipeline.errors import InputError
from pipeline.logs.trajectories import load_trajectories

# Records of seven codes; together they have every key, type, kind and verdict that the plant's records ever had.
SAMPLE = Path(__file__).with_name("ledger_sample.jsonl")


@pytest.fixture
def short(monkeypatch):
    """Sessions of half a minute."""
    monkeypatch.setattr("benchmarks.closed_loop.draw.MEASURED_MINUTES", (0.5, 0.5))
    monkeypatch.setattr("benchmarks.closed_loop.draw.EXAM_MINUTES", 0.5)
    monkeypatch.setattr("benchmarks.closed_loop.draw.NOMINAL_MINUTES", (0.5, 0.5))


def test_what_the_plant_draws_has_not_changed():
    """Drawn when there was no other simulator. Numbers of these truths come from chances alone, so they are exact."""
    pinned = {  # name of the case and digest of its seal
        ("delay", 7, 2): ("f25ee618f1b4", "39e072e64ff5"),
        ("null", 160003, 1): ("0321678b0488", "48005409f2c6"),
        ("sensor_bias", 4, 1): ("75dc32e629d5", "e2c3d2ad92c1"),
    }
    for (kind, seed, number), (name, digest) in pinned.items():
        assert case_name(kind, seed) == name
        text = draw_plan(kind, seed, number).truth.to_json()
        assert hashlib.sha256(text.encode()).hexdigest()[:12] == digest
    assert variant_name(PLANT, 3) == "variant_3"


def test_simulators_share_no_folder_and_no_chances():
    names = {variant_name(s, number) for s in SIMULATORS.values() for number in range(N_VARIANT)}
    assert len(names) == N_VARIANT * len(SIMULATORS)
    seeds = {variant(s, number).style_seed for s in SIMULATORS.values() for number in range(N_VARIANT)}
    assert len(seeds) == N_VARIANT * len(SIMULATORS)
    plans = [draw_plan("null", 5, 0, simulator=s) for s in SIMULATORS.values()]
    assert plans[0].measured[0].seed != plans[1].measured[0].seed
    assert len(OUTSIDE) == len(set(OUTSIDE)) and set(kinds.in_order(PLANT.outside)) < set(KINDS)


@pytest.mark.parametrize("simulator", SIMULATORS.values(), ids=lambda s: s.name)
def test_a_simulator_states_all_that_the_benchmark_asks_for(simulator):
    known = set(kinds.FAMILIES) | set(simulator.outside)
    assert set(simulator.largest_size) == known
    assert set(simulator.often_unseen) <= known
    for kind in ("delay", "lag", "backlash", "sensor_bias", "timing", *simulator.outside):  # quick ones
        effect = simulator.draw_effect(kind, 3, variant(simulator, 0), 0.5)
        assert effect.kind == kind
        assert effect.family == ("other" if kind in simulator.outside else kind)
        assert effect.cause and all(quantity.unit for quantity in effect.truth.values())
        assert effect.apply(variant(simulator, 0).parameters) is not None


def test_the_kinematic_simulator_draws_each_kind_of_case(short):
    for kind in ("null", "pair", "half", "in_nominal", "change_point"):
        one, again = (draw_case(kind, 4, 0, simulator=KINEMATIC) for _ in range(2))
        assert one.truth == again.truth
        for first, second in zip(one.nominal + one.measured, again.nominal + again.measured, strict=True):
            np.testing.assert_array_equal(first.q, second.q)
        sound = variant(KINEMATIC, 0)
        plan = draw_plan(kind, 4, 0, simulator=KINEMATIC)
        is_sound = [s.parameters is sound.parameters for s in (*plan.nominal, *plan.measured, *plan.exam)]
        assert is_sound[:2] == [kind != "in_nominal"] * 2
        if kind != "change_point":
            assert is_sound[2:] == [kind == "null"] * 3
    onset = plan.truth.effects[0].onset
    [session] = [s for s in plan.measured if s.name == onset.trajectory]
    assert [time_s for time_s, _ in session.changes] == [onset.t]


def test_kinds_of_another_simulator_are_refused():
    with pytest.raises(InputError, match="not known to the simulator kinematic"):
        draw_plan("coil_fade", 0, 0, simulator=KINEMATIC)
    with pytest.raises(InputError, match="not known to the simulator plant"):
        draw_plan("hold_fade", 0, 0)


class Ruler:
    """In place of a baseline model: the error of a joint grows by its dead time in seconds, as a share."""

    floor = np.full(4, 0.01)

    def errors(self, sessions):
        return self.floor * (1.0 + sessions[0].parameters.quantities.command_path.dead_time_s)


def test_sizes_are_calibrated_with_the_simulators_own_bounds(monkeypatch):
    monkeypatch.setattr("benchmarks.closed_loop.calibration.yardstick", lambda root, of: Ruler())
    of = variant(KINEMATIC, 0)
    weak = Calibration(Path("nowhere"))(of, "delay", 3, 0.9, False)
    assert weak.size == KINEMATIC.largest_size["delay"]  # dead times never add that much here
    assert weak.ratio < weak.wanted_ratio
    small = Calibration(Path("nowhere"))(of, "delay", 3, 0.0, True)
    assert 0.0 < small.size < weak.size and small.ratio == pytest.approx(small.wanted_ratio, rel=0.1)


class InProcess(Executor):
    """Workers that are this process, in which parts are replaced."""

    def __init__(self, *_, **__):
        pass

    def map(self, function, *iterables, **_):
        return map(function, *iterables)


def run_generate(monkeypatch, root, *arguments):
    monkeypatch.setattr(generate, "ProcessPoolExecutor", InProcess)
    monkeypatch.setattr(generate, "Calibration", lambda root: plain)
    monkeypatch.setattr(generate, "yardstick", lambda root, of: None)
    monkeypatch.setattr("sys.argv", ["generate", str(root), "--first-seed", "9", *arguments])
    generate.main()


def test_kinematic_cases_are_generated_end_to_end(short, tmp_path, monkeypatch):
    chosen = ("delay", "hold_fade", "change_point", "in_nominal", "null")
    arguments = ("--seeds", "1", "--variants", "2", "--kinds", *chosen)
    run_generate(monkeypatch, tmp_path, "--simulator", "kinematic", *arguments)
    folders = Folders(tmp_path)
    assert sorted(folders.complete_cases()) == sorted(case_name(kind, 9, KINEMATIC) for kind in chosen)
    for name in folders.complete_cases():
        truth = from_json((folders.seals / f"{name}.json").read_text())
        assert truth.simulator == "kinematic" and truth.kind in chosen
        case = folders.cases / name
        content = json.loads((case / CASE_FILE).read_text())
        own = truth.kind == "in_nominal"
        assert content == {"model": None if own else f"models/kinematic_variant_{truth.variant}"}
        for part, n_log in (("nominal", 2), ("measured", 2), ("exam", 1)):
            logs = load_trajectories(case / part, machine(), *ingest_settings())
            assert len(logs) == n_log and all(len(log.q) > 500 for log in logs)
        again = draw_case(truth.kind, 9, truth.variant, simulator=KINEMATIC)
        np.testing.assert_allclose(
            load_trajectories(case / "exam", machine(), *ingest_settings())[0].q, again.exam[0].q
        )
    told = " ".join(argument for task in tasks(folders, False, []) for argument in task.arguments)
    assert not any(kind in told for kind in chosen)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.json")}
    run_generate(monkeypatch, tmp_path, "--simulator", "kinematic", *arguments)
    assert before == {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.json")}
    with pytest.raises(SystemExit):
        run_generate(
            monkeypatch, tmp_path, "--simulator", "kinematic", "--seeds", "1", "--kinds", "coil_fade"
        )


def test_cases_of_both_simulators_lie_below_one_root(short, tmp_path, monkeypatch):
    for simulator in SIMULATORS:
        run_generate(monkeypatch, tmp_path, "--simulator", simulator, "--seeds", "1", "--kinds", "null")
    assert len(Folders(tmp_path).complete_cases()) == 2
    assert len(list((tmp_path / "nominal").iterdir())) == 2


def truth_from(simulator):
    return Truth(1, "null", 0, "same", (), simulator)


def test_a_seal_names_its_simulator_unless_it_is_the_plant():
    kinematic, plant = truth_from("kinematic"), truth_from("plant")
    assert json.loads(kinematic.to_json())["simulator"] == "kinematic"
    assert "simulator" not in json.loads(plant.to_json())
    for truth in (kinematic, plant):
        assert from_json(truth.to_json()) == truth
    assert from_content(asdict(plant)) == plant  # stated nevertheless


def test_ledgers_from_before_are_of_the_plant_and_lose_nothing(tmp_path):
    path = tmp_path / "ledger.jsonl"
    rows = [json.loads(line) for line in SAMPLE.read_text(encoding="utf-8").splitlines()]
    before = [row for row in rows if row["truth"].pop("simulator", "plant") == "plant"]
    assert before
    path.write_text("".join(json.dumps(row) + "\n" for row in before), encoding="utf-8")
    written = path.read_bytes()
    present = ledger.read(path)
    assert {record.truth.simulator for record in present} == {"plant"}
    new = Record("new", False, "code", truth_from("kinematic"), Solution(0, 1.0, None, None), None)
    assert ledger.add(path, [new])[-1] == new
    *old, added = path.read_bytes().splitlines(keepends=True)
    assert b"".join(old) == written
    assert json.loads(added)["truth"]["simulator"] == "kinematic"
    assert ledger.read(path) == [*present, new]


def test_a_score_is_of_the_simulators_asked_for(tmp_path, monkeypatch, capsys):
    path = tmp_path / "ledger.jsonl"
    quiet = Solution(0, 1.0, {"verdict": "none", "detected": False, "effects": []}, None)
    ledger.add(path, [Record(f"of_{s}", False, "code", truth_from(s), quiet, None) for s in SIMULATORS])
    for asked, shown in (([], ("plant", "kinematic")), (["kinematic"], ("kinematic",))):
        chosen = ["--simulator", *asked] if asked else []
        monkeypatch.setattr("sys.argv", ["score", "--ledger", str(path), "--code", "code", *chosen])
        score()
        text = capsys.readouterr().out
        head = f"Simulators: {', '.join(f'1 from {name}' for name in shown)}."
        assert head in text.splitlines()[0]
        for name in SIMULATORS:
            assert (f"| of_{name} | null 1 | – | {name} | 0, same |" in text) == (name in shown)
