"""Energy and oil are neither made nor lost."""

import numpy as np
import pytest

from pipeline.plant.machines.characterise import without_variation
from pipeline.plant.physics.load import dynamics, potential_energy
from pipeline.plant.physics.oil import effective_bulk_modulus
from pipeline.plant.scratch import allocate
from pipeline.plant.simulator import Plant
from pipeline.plant.state import (
    BYPASSED,
    CONSUMED,
    DELIVERED,
    FRICTION,
    PISTON,
    PUMP,
    RELIEVED,
    STOP,
    STORED,
    THROTTLED,
)

from .conftest import MIDDLE, random_commands


@pytest.fixture(scope="module")
def trial(nominal):
    """A minute of wild motion: the plant, and its accounts before and after."""
    plant = Plant(nominal, 3, MIDDLE)
    plant.run(np.zeros((20, 4)))
    begin = {"energy": plant.state.energy_J.copy(), "volume": plant.state.volume_m3.copy()}
    begin |= {
        "mechanical": mechanical_energy(nominal, plant),
        "compression": compression_energy(nominal, plant),
    }
    plant.run(random_commands(1, 40, 30))
    end = {"energy": plant.state.energy_J.copy(), "volume": plant.state.volume_m3.copy()}
    end |= {
        "mechanical": mechanical_energy(nominal, plant),
        "compression": compression_energy(nominal, plant),
    }
    return {key: end[key] - begin[key] for key in end}


def mechanical_energy(parameters, plant):
    scratch = allocate(4)
    q, v = plant.state.angle_rad.copy(), plant.state.velocity_rad_s.copy()
    dynamics(parameters.links, q, v, scratch)
    return 0.5 * v @ scratch.mass @ v + potential_energy(parameters.links, q)


def compression_energy(parameters, plant):
    """Upper estimate of the energy in compressed oil: p² V / 2β with the softest β in use."""
    oil = parameters.oil
    volume = parameters.supply.volume_m3 + np.sum(
        parameters.cylinder.dead_volume_m3 + parameters.cylinder.area_m2 * parameters.linkage.travel_m[:, -1:]
    )
    pressure = max(plant.state.supply_Pa[0], plant.state.chamber_Pa.max())
    beta = effective_bulk_modulus(oil.bulk_modulus_Pa, oil.hose_modulus_Pa[0], oil.air_fraction[0], pressure)
    return pressure**2 * volume / (2.0 * beta)


def test_pump_energy_goes_into_throttling_and_pistons(trial):
    pump, throttled, piston = (trial["energy"][i] for i in (PUMP, THROTTLED, PISTON))
    assert pump > 20e3
    stored = pump - throttled - piston
    assert abs(stored) < 0.01 * pump  # compressed oil holds some ten joules, the rest is discretisation


def test_piston_work_goes_into_load_friction_and_stops(trial):
    piston, friction, stop = (trial["energy"][i] for i in (PISTON, FRICTION, STOP))
    assert friction > 0.0
    assert stop >= 0.0
    missing = piston - friction - stop - trial["mechanical"]
    assert abs(missing) < 0.02 * (abs(piston) + friction)


def test_pump_power_exceeds_work_and_losses(nominal):
    """In no period do mechanical work and losses exceed what the pump gives and the oil had stored."""
    plant = Plant(nominal, 0, MIDDLE)
    plant.run(np.zeros((20, 4)))
    stored = compression_energy(nominal, plant)
    account = plant.state.energy_J.copy()
    for command in random_commands(2, 20, 15):
        plant.step(command)
        used = plant.state.energy_J - account
        assert used[PISTON] + used[THROTTLED] <= used[PUMP] + stored + 0.01 * used[PUMP]
        assert used[THROTTLED] >= 0.0


def test_every_litre_of_the_pump_is_accounted_for(trial):
    volume = trial["volume"]
    used = volume[BYPASSED] + volume[RELIEVED] + volume[CONSUMED] + volume[STORED]
    assert used == pytest.approx(volume[DELIVERED], rel=1e-9)


def test_consumed_flow_never_exceeds_the_pump(nominal):
    """All four spools open: what the chambers take is at most what pump and compressed supply give."""
    plant = Plant(without_variation(nominal), 0, MIDDLE)
    plant.run(np.zeros((20, 4)))
    before = plant.state.volume_m3.copy()
    for _ in range(150):
        plant.step(np.array([1, 1, 1, 1]))
        flow = plant.state.volume_m3 - before
        before = plant.state.volume_m3.copy()
        assert flow[CONSUMED] + flow[STORED] <= flow[DELIVERED] * (1 + 1e-9)
        period = plant.parameters.numerics.control_period_s
        assert flow[DELIVERED] <= nominal.supply.pump_flow_m3_s * period
