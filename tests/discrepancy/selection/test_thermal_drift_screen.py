"""Oil that warms up, in logs that end before it is warm: which of its values are freed, and what they come out as."""

import numpy as np
import pytest

from pipeline.discrepancy.diagnosis.nominal.null_gains import null_gains
from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows, rows_in_blocks
from pipeline.discrepancy.diagnosis.simulation import NOMINAL, Simulation
from pipeline.discrepancy.families.contract_parameters import describe
from pipeline.discrepancy.families.plausibility import is_plausible
from pipeline.discrepancy.selection.candidate import Candidate, Misfit, Nominal
from pipeline.discrepancy.selection.refine import completed, refine
from pipeline.discrepancy.selection.screen import screen
from pipeline.discrepancy.selection.selected_effect import SelectedEffect
from tests.discrepancy.exact_machine import DT_S, N_JOINT, SPEED, held_commands, simulation_of

N_ROWS = 7200  # six minutes
NOISE = 0.02
COLD, WARM = (("cold_speed_loss", None),), (("warm_gain", None),)


def drifting(
    loss: float,
    constant_s: float,
    mean_loss: float = 0.0,
    change: float = 0.0,
    families: tuple[str, ...] = ("thermal_drift",),
) -> tuple[Simulation, ScoredRows]:
    """A log of a machine that loses `loss` when cold; the model's speeds lack its mean loss, and a change for good."""
    command = held_commands(1, N_ROWS)
    decay = np.exp(-DT_S * np.arange(N_ROWS) / constant_s)[:, None]
    ratio = (1.0 - loss * decay + change) / (1.0 - mean_loss)
    noise = NOISE * np.random.default_rng(2).standard_normal(command.shape)
    simulation = simulation_of(list(families), command, ratio * SPEED * command + noise)
    is_used = np.ones((1, N_ROWS), bool)
    fold = (np.arange(N_ROWS) // 400 % 2)[None]
    floor = np.full(N_JOINT, NOISE**2 / 2)  # of means over two rows
    return simulation, rows_in_blocks(is_used, fold, np.ones((1, N_ROWS, N_JOINT), bool), floor, 400)


def found_of(simulation: Simulation, rows: ScoredRows, nominal: Nominal | None = None) -> list[Candidate]:
    """One per joint, in their order."""
    return sorted(screen(simulation, NOMINAL, rows, nominal=nominal or {}), key=lambda c: c.joint)


def described(simulation: Simulation, candidate: Candidate) -> dict[str, float]:
    effect = simulation.effects["thermal_drift"]
    told = describe(candidate, effect, {}, ["lift", "turn"], "rad")
    return {name: float(of["value"]) for name, of in told.items()}  # type: ignore[arg-type]


@pytest.mark.parametrize("constant_s", [110.0, 230.0, 270.0])
def test_where_nominal_logs_lost_nothing_the_time_constant_comes_out(constant_s: float) -> None:
    simulation, rows = drifting(0.3, constant_s)
    candidates = found_of(simulation, rows)
    assert [c.freed for c in candidates] == [(COLD,)] * N_JOINT
    refined = refine(simulation, rows, [SelectedEffect(completed(simulation, c)) for c in candidates])
    for of in refined:
        assert [one[0][0] for one in of.candidate.freed] == ["cold_speed_loss", "cold_lag"]
        told = described(simulation, of.candidate)
        assert told["time_constant"] == pytest.approx(constant_s, rel=0.1)
        assert told["cold_speed_loss"] == pytest.approx(0.3, abs=0.02)
        assert told["cold_lag"] == pytest.approx(0.0, abs=0.02)
        assert is_plausible("thermal_drift", [of.candidate])


def test_where_nominal_logs_lost_speed_too_their_loss_is_needed() -> None:
    simulation, rows = drifting(0.3, 110.0, mean_loss=0.1)
    for candidate in found_of(simulation, rows):
        assert candidate.freed == (COLD, WARM)
        refined = refine(simulation, rows, [SelectedEffect(completed(simulation, candidate))])[0].candidate
        told = described(simulation, refined)
        assert told["time_constant"] == pytest.approx(110.0, rel=0.1)
        assert told["cold_speed_loss"] == pytest.approx(0.3, abs=0.02)  # of the machine's warm speed
        assert refined.coefficient_of("warm_gain") == pytest.approx(1.0 / 0.9 - 1.0, abs=0.02)


def test_a_speed_that_is_lower_for_good_is_no_oil_that_stays_cold() -> None:
    for candidate in found_of(*drifting(0.0, 230.0, change=-0.2)):
        assert candidate.freed == (WARM,)
        assert candidate.coefficient_of("warm_gain") == pytest.approx(-0.2, abs=0.01)
        assert candidate.coefficient_of("cold_speed_loss") == 0.0
        assert candidate.index_of("cold_speed_loss") is None
        assert not is_plausible("thermal_drift", [candidate])


@pytest.mark.parametrize("mean_loss", [0.0, 0.1])
def test_what_is_owed_does_not_depend_on_the_variant_that_wins(mean_loss: float) -> None:
    """Nominal logs free the loss alone; here it wins, too, or it does not."""
    nominal, nominal_rows = drifting(0.05, 230.0)
    misfits = {c.key: Misfit(c, 100.0) for c in found_of(nominal, nominal_rows)}
    assert {misfit.candidate.freed for misfit in misfits.values()} == {(COLD,)}
    simulation, rows = drifting(0.3, 230.0, mean_loss)
    for candidate in found_of(simulation, rows, misfits):
        assert candidate.freed == ((COLD,) if mean_loss == 0.0 else (COLD, WARM))
        known = misfits[candidate.key].candidate
        loss = known.coefficient_of("cold_speed_loss")
        decay = np.exp(-DT_S * np.arange(N_ROWS) / known.point["time_constant"])
        nominal_speed = SPEED[candidate.joint] * simulation.sequences.command[0, :, candidate.joint]
        left = simulation.sequences.velocity[0, :, candidate.joint] - nominal_speed
        before = rows.averaged(left[None])
        after = rows.averaged((left + loss * decay * nominal_speed)[None])
        explained = np.sum(before**2 - after**2) / rows.floor[candidate.joint]
        assert candidate.owed == pytest.approx(explained, rel=1e-3)
        assert explained > 1000.0


@pytest.mark.parametrize(("loss", "is_there"), [(0.0, False), (0.015, False), (0.3, True)])
def test_nominal_logs_that_all_joints_warm_up_in_are_no_evidence_against_it(
    loss: float, is_there: bool
) -> None:
    simulation, rows = drifting(loss, 110.0)
    null = null_gains(simulation, rows, (), 3.0)
    assert null.present == (("thermal_drift",) if is_there else ())
    assert is_there != any(family == "thermal_drift" for family, *_ in null.misfits)
