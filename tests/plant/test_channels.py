"""The simulated machine's further sensors, against the solution of a first-order lag and against the plant's state."""

from datetime import UTC, datetime

import numpy as np
import pytest

from pipeline.configuration.load import load_section
from pipeline.logs.ingest import ingest
from pipeline.logs.ingest_config import IngestConfig
from pipeline.logs.loop_tracker import LoopTrackerConfig
from pipeline.logs.tuples import read_tuples
from pipeline.plant.machines.simulated import Condition
from pipeline.plant.recording import session as session_module
from pipeline.plant.recording.channels import RATED_ENGINE_RPM, SENSORS, measure, true_values
from pipeline.plant.recording.operator import draw_style
from pipeline.plant.recording.session import record_session
from pipeline.plant.simulator import Plant
from pipeline.testbench.recording import Session, record_sessions

PERIOD_S = 0.05


def test_a_constant_is_measured_without_bias_and_with_the_stated_noise():
    true = np.tile([55.0, 120.0, 1950.0], (200_001, 1))
    for (name, sensor), exact in zip(SENSORS.items(), true[0], strict=True):
        log = measure(true, PERIOD_S, 1)[name]
        spread = np.hypot(sensor.noise_std, sensor.resolution / np.sqrt(12))
        assert log.value.mean() == pytest.approx(exact, abs=5 * spread / np.sqrt(len(log.value)))
        assert log.value.std() == pytest.approx(spread, rel=0.05)
        np.testing.assert_allclose(
            log.value / sensor.resolution, np.round(log.value / sensor.resolution), atol=1e-6
        )
        delay_s = log.log_s - np.arange(len(log.log_s)) * sensor.n_period * PERIOD_S
        assert np.all(delay_s >= 0.001 - 1e-9) and np.all(delay_s < 0.005 + 1e-9)


def test_a_step_is_followed_as_by_a_first_order_lag():
    size = 1e5  # beside which noise is small
    true = np.concatenate([np.zeros((1, 3)), np.full((400, 3), size)])
    for name, sensor in SENSORS.items():
        log = measure(true, PERIOD_S, 2)[name]
        time_s = PERIOD_S * sensor.n_period * np.arange(len(log.value))
        exact = size * (1 - np.exp(-time_s / sensor.time_constant_s))
        np.testing.assert_allclose(log.value, exact, atol=6 * sensor.noise_std)


def test_true_values_are_the_plants_state(nominal, machine):
    plant = Plant(nominal, 3, 0.5 * (machine.lower + machine.upper))
    assert true_values(plant)[0] == nominal.oil.start_C
    plant.run(np.tile([[1, 1, -1, 0]], (40, 1)))
    oil_C, pressure_bar, speed_rpm = true_values(plant)
    assert pressure_bar == plant.state.supply_Pa[0] / 1e5 and 20 < pressure_bar < 250
    assert oil_C == plant.state.oil_C[0] and 0.8 * RATED_ENGINE_RPM < speed_rpm < 1.1 * RATED_ENGINE_RPM


def test_joint_states_and_commands_do_not_depend_on_the_sensors(machine, nominal, monkeypatch):
    with_sensors = record_session(machine, nominal, draw_style(0), 0.2, 1, 0)
    monkeypatch.setattr(session_module, "measure", lambda *_: {})
    without = record_session(machine, nominal, draw_style(0), 0.2, 1, 0)
    assert set(with_sensors.channels) == set(SENSORS) and without.channels == {}
    for name in ("positions", "commands", "joint_state_log_time_ns", "command_log_time_ns"):
        np.testing.assert_array_equal(getattr(with_sensors, name), getattr(without, name))


def test_record_writes_them_and_ingest_reads_them(machine, tmp_path):
    class Silent:
        def __enter__(self):
            return self

        def __exit__(self, *_):
            return None

        def reach(self, done):
            pass

    session = Session(0, tmp_path / "sessions" / "a", 0.2, 0, 1, datetime(2024, 5, 6, tzinfo=UTC))
    record_sessions(tmp_path, [session], machine, [], Condition.workshop, lambda *_: Silent())
    config = load_section("ingest", IngestConfig)
    tracker = load_section("control.loop_tracker", LoopTrackerConfig)
    (report,) = ingest(machine, tmp_path / "sessions", tmp_path / "tuples", config, tracker).reports
    assert [report.metrics[f"x_{name}/n"] for name in SENSORS] == [13, 241, 121]
    (rows,) = read_tuples(tmp_path / "tuples", machine)
    assert all(np.isfinite(rows.channels[name]).all() for name in SENSORS)
    assert 10 < rows.channels["oil_temperature"].mean() < 80
