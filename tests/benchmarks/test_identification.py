"""The benchmark of identification: what it measures, keeps and scores."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from benchmarks.closed_loop.machines import variant
from benchmarks.closed_loop.sessions import machine
from benchmarks.closed_loop.simulators import KINEMATIC
from benchmarks.identification import ledger, recordings
from benchmarks.identification.__main__ import parse, run_logs, run_machines
from benchmarks.identification.kinds import Stopped, fits_of
from benchmarks.identification.ledger import Row
from benchmarks.identification.measure import coverage, errors
from benchmarks.identification.recordings import durations, repeatability
from benchmarks.identification.ridge import LAGS, fit_ridge
from benchmarks.identification.score import (
    Results,
    coverage_table,
    error_table,
    goal_table,
    interval,
    write_score,
)
from pipeline.errors import InputError
from pipeline.logs.tuples import Trajectory

DT_S = 0.05


def logged(q, a):
    t_s = DT_S * np.arange(len(q))
    is_validation = np.arange(len(q)) >= 0.9 * len(q)
    return Trajectory(
        "log", t_s, (1e9 * t_s).astype(np.int64), q, np.gradient(q, DT_S, axis=0), a, is_validation
    )


def test_more_minutes_hold_fewer():
    assert durations(24.0) == durations(12.0) * 2
    assert durations(76.0) == [12.0] * 6 + [4.0]


class Chances:
    """A simulator in place: every replay is the session's path and noise of known size."""

    std = np.array([0.01, 0.02, 0.03, 0.04])

    def path(self, seed, n):
        return np.random.default_rng(seed).normal(0.0, self.std, (n, 4))

    def replay(self, machine, log, session_seed, starts, horizon, seed):
        return self.path(seed, len(starts) * horizon).reshape(1, len(starts), horizon, 4)


def test_the_floor_is_the_error_of_the_mean_of_replays():
    chances = Chances()
    moved = chances.path(1, 40_000)
    moved[799::800] = 0.0  # where stretches begin

    class Session:
        seed = 0

        def record(self):
            return type("Log", (), {"commands": moved, "true_positions": moved})

    of = replace(variant(KINEMATIC, 0), simulator=chances)
    squares, n = repeatability(of, Session(), 800, 2)
    np.testing.assert_allclose(np.sqrt(squares / n), chances.std, rtol=0.03)


class Known:
    """Predicts what was, and a normal error of known size that grows with time."""

    rows_before = 0

    def std(self, horizon):
        return 1e-3 * np.arange(1, horizon + 1)[:, None] * np.ones(4)

    def predict(self, trajectory, starts, horizon):
        rows = starts[:, None] + 1 + np.arange(horizon)
        random = np.random.default_rng(horizon + len(starts))
        return trajectory.q[rows] + self.std(horizon) * random.standard_normal((len(starts), horizon, 4))


def test_errors_are_those_of_each_horizon():
    found = errors(Known(), [logged(np.zeros((20_000, 4)), np.zeros((20_000, 4)))])
    assert found["1"] == pytest.approx([1e-3] * 4, rel=0.05)
    for horizon in (80, 1000):
        expected = 1e-3 * np.sqrt(np.mean(np.arange(1, horizon + 1) ** 2))
        assert found[str(horizon)] == pytest.approx([expected] * 4, rel=0.05)
    assert "1000" not in errors(Known(), [logged(np.zeros((900, 4)), np.zeros((900, 4)))])


def test_a_predictor_without_a_band_has_no_coverage():
    logs = [logged(np.zeros((900, 4)), np.zeros((900, 4)))]
    assert coverage(Known(), logs) == {}


def impulse_responses(a, places):
    """Speeds of a machine that is what the regression supposes; (T, 4), rad/s."""
    taps = 0.5 * np.exp(-np.arange(LAGS) / 5.0) / 5.0
    padded = np.pad(a, ((LAGS - 1, 0), (0, 0)))
    windows = np.lib.stride_tricks.sliding_window_view(padded, LAGS, axis=0)  # (T, 4, LAGS), the newest last
    up, down = np.maximum(windows, 0.0), np.maximum(-windows, 0.0)
    slowed = up * (1.0 + 0.3 * places[0]) - 0.8 * down * (1.0 - 0.2 * np.abs(windows[:, [1, 2, 3, 0]]))
    return slowed @ taps[::-1]


def test_ridge_finds_a_machine_of_its_form():
    random = np.random.default_rng(0)
    a = np.repeat(random.integers(-1, 2, (700, 4)), 5, axis=0).astype(float)
    q = np.concatenate([np.zeros((1, 4)), DT_S * np.cumsum(impulse_responses(a, [0.4]), axis=0)[:-1]])
    wide = replace_limits(machine(), 100.0)
    found = fit_ridge([logged(q, a)], wide, 0)
    starts = np.arange(40, 3000, 400)
    predicted = found.predict(logged(q, a), starts, 80)
    np.testing.assert_allclose(predicted, q[starts[:, None] + 1 + np.arange(80)], atol=2e-3)


def replace_limits(specification, limit):
    joints = [replace(joint, lower=-limit, upper=limit) for joint in specification.joints]
    return replace(specification, joints=joints)


def test_references_stop_where_joints_end():
    class Driven:
        rows_before = 0

        def predict(self, trajectory, starts, horizon):
            ramp = np.concatenate([np.arange(1, 31), 30.0 - np.arange(1, horizon - 29)])
            return trajectory.q[starts][:, None] + 0.1 * ramp[:, None] * np.ones((len(starts), 1, 4))

    log = logged(np.zeros((100, 4)), np.zeros((100, 4)))
    path = Stopped(Driven(), replace_limits(machine(), 1.0)).predict(log, np.array([10]), 80)[0]
    assert path.max() == 1.0 and path[29, 0] == 1.0
    assert path[34, 0] == pytest.approx(0.5)  # turns back at once


def test_a_ledger_goes_on_behind_an_unfinished_line(tmp_path):
    path = tmp_path / "ledger.jsonl"
    first, later = (Row("plant_9", 24.0, 0, "arx", {"80": [value] * 4}) for value in (0.01, 0.02))
    ledger.add(path, first)
    with path.open("a") as file:
        file.write('{"machine": "pla')
    assert list(ledger.read(path).values()) == [first]
    ledger.add(path, later)
    assert list(ledger.read(path).values()) == [later]
    path.write_text("{}\n" + path.read_text())
    with pytest.raises(InputError, match="line 1"):
        ledger.read(path)


@pytest.mark.parametrize("name", ["mlp", "mlp_dqdot:width=3", "mlp_dqdot:horizon=0"])
def test_a_kind_that_is_not_there_is_named(name):
    with pytest.raises(InputError, match="identify"):
        fits_of([name], None)


def test_kinds_are_fitted_once(tmp_path, monkeypatch):
    monkeypatch.setattr(recordings, "HELD_OUT_MINUTES", (1.2,))
    monkeypatch.setattr(recordings, "FLOOR_HORIZONS", (80,))
    words = ["machines", str(tmp_path), "--kinematic", "8", "--minutes", "1.5", "--kinds", "arx"]
    arguments = parse(words)
    run_machines(arguments, fits_of(["arx"], None))
    found = ledger.read(tmp_path / "ledger.jsonl")
    name = "kinematic_8"
    assert list(found) == [(name, 0.0, 0, "floor"), (name, 1.5, 0, "arx")]
    floor, arx = (np.array(row.errors["80"]) for row in found.values())
    assert np.all(arx > floor) and np.all(floor > 1e-4)
    run_machines(arguments, {})  # would fail if a kind were fitted


def test_each_log_of_a_folder_is_held_out_once(tmp_path, monkeypatch):
    random = np.random.default_rng(0)
    logs = [
        replace(logged(random.normal(size=(600, 4)), random.normal(size=(600, 4))), name=n)
        for n in ("a", "a#1", "b")
    ]
    monkeypatch.setattr("benchmarks.identification.__main__.read_logs", lambda of, folder: logs)
    learned = []

    def fit(learning, machine, seed):
        learned.append([trajectory.name for trajectory in learning])
        return Known()

    arguments = parse(["logs", str(tmp_path), "--machine", "rc_excavator", "--logs", "x", "--kinds", "arx"])
    run_logs(arguments, {"arx": fit})
    assert learned == [["b"], ["a", "a#1"]]
    assert [key[0] for key in ledger.read(tmp_path / "ledger.jsonl")] == ["rc_excavator/a", "rc_excavator/b"]


def row(machine, kind, error, minutes=24.0, seed=0, **more):
    return Row(machine, minutes, seed, kind, {"80": [error] * 4, "1": [1e-3] * 4}, **more)


def test_the_score_holds_the_goals_against_the_new_kind(tmp_path, capsys):
    band = {step: {"covered": [0.86, 0.9, 0.9, 0.96], "width": [0.02] * 4} for step in ("20", "80")}
    rows = [
        Row("plant_9", 0.0, 0, "floor", {"80": [0.010] * 4, "1000": [0.02] * 4}),
        *(row("plant_9", "mlp_dqdot", error, seed=seed) for seed, error in enumerate((0.019, 0.021))),
        row("plant_9", "nfir_dqdot", 0.012, coverage=band),
        row("plant_9", "nfir_dqdot", 0.0205, minutes=12.0),
        row("plant_9", "arx", 0.024),
        row("rc_excavator/a", "arx", 0.003, minutes=16.0),
        row("rc_excavator/b", "arx", 0.005, minutes=17.0),
    ]
    goals, coverages = (of(Results(rows)).splitlines()[2] for of in (goal_table, coverage_table))
    assert goals == "| plant_9 | 0.60 | **44%** | **320%** | **1.02** |"
    assert coverages == "| plant_9 | 1 s | 86%; 20 | 90%; 20 | 90%; 20 | **96%**; 20 |"
    assert "| mlp_dqdot | 20.0 ± 1.4 |" in error_table(Results(rows), 24.0)
    write_score(rows, tmp_path / "table.md", tmp_path / "plot.png")
    table = (tmp_path / "table.md").read_text()
    assert "| arx | 4.00 (1.000) | 4.00 (1.000) | 4.00 (1.000) | 4.00 (1.000) | 2 | 0 |" in table
    assert (
        "| model | swing, mrad | boom, mm | arm, mm | bucket, mm | logs |" in table
        and "16 minutes" not in table
    )
    assert capsys.readouterr().out == table + "\n"
    assert (tmp_path / "plot.png").read_bytes().startswith(b"\x89PNG")


def test_the_interval_of_a_ratio_is_that_of_its_logarithm():
    ratios = [0.5, 0.6, 0.8, 0.7]
    mean, low, high = interval(ratios)
    expected = stats.t.interval(0.95, 3, np.mean(np.log(ratios)), stats.sem(np.log(ratios)))
    np.testing.assert_allclose([low, high], np.exp(expected))
    assert mean == pytest.approx(np.exp(np.mean(np.log(ratios))))
    assert json.dumps(interval([0.5])) == "[0.5, 0.0, Infinity]"
