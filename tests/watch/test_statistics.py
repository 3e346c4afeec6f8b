"""Statistics of residuals that are made here, of one cause each."""

import numpy as np
import pytest

from pipeline.watch.statistics import STATISTICS, Rows, Scale, session_statistics
from tests.discrepancy.exact_machine import held_commands

DT_S, SPEED = 0.05, np.array([0.4, 0.6])
SCALE = Scale(np.full(2, -1.0), np.full(2, 1.0), SPEED, DT_S)
NAMES = [statistic.name for statistic in STATISTICS]


def machine(seed: int = 0, n_rows: int = 6000) -> Rows:
    """Joints of first order that do as the nominal ones, but for noise."""
    random = np.random.default_rng(seed)
    command = held_commands(seed, n_rows)
    u, q = np.zeros((n_rows, 2)), np.zeros((n_rows, 2))
    for row in range(1, n_rows):
        u[row] = u[row - 1] + 0.2 * (SPEED * command[row] - u[row - 1])
        q[row] = np.clip(q[row - 1] + DT_S * u[row], -1.0, 1.0)
    noise = 0.01 * SPEED * random.standard_normal(u.shape)
    return Rows(command, q, u + noise, u, DT_S * np.arange(n_rows), np.ones(u.shape, bool))


def found(rows: Rows) -> dict[str, np.ndarray]:
    return dict(zip(NAMES, session_statistics([rows], SCALE, 8.0).T, strict=True))


def lasting(u: np.ndarray) -> np.ndarray:
    return np.concatenate([u[:2], u[:-2]])


def test_a_sound_machine_shows_nothing_worth_telling() -> None:
    least = np.array([statistic.least for statistic in STATISTICS])
    assert np.all(np.abs(session_statistics([machine()], SCALE, 8.0))[:, :-1] < least[:-1])


@pytest.mark.parametrize(
    ("name", "changed", "size"),
    [
        ("speed_forward", lambda v, u: v - 0.2 * np.maximum(u, 0.0), -0.2),
        ("speed_backward", lambda v, u: v - 0.2 * np.minimum(u, 0.0), -0.2),
        ("lateness", lambda v, u: v + lasting(u) - u, 0.1),
        ("drift", lambda v, u: v - 0.03 * SPEED, -0.03),
    ],
)
def test_what_changed_is_measured_in_its_unit(name, changed, size) -> None:  # type: ignore[no-untyped-def]
    rows = machine()
    velocity = rows.velocity.copy()
    velocity[:, 1] = changed(rows.velocity, rows.nominal)[:, 1]
    of = found(rows._replace(velocity=velocity))
    assert of[name][1] == pytest.approx(size, rel=0.15)
    assert abs(of[name][0]) < 0.1 * abs(size)  # the other joint is as it was


def test_speed_that_others_take_is_demand_and_not_speed() -> None:
    rows = machine()
    share = rows.nominal / SPEED
    taken = 0.1 * share[:, 1] * (np.abs(share[:, 0]) - np.mean(np.abs(share[:, 0])))
    velocity = rows.velocity - np.stack([0.0 * taken, SPEED[1] * taken], axis=1)
    of = found(rows._replace(velocity=velocity))
    assert of["demand"][1] == pytest.approx(-0.1, rel=0.15)
    assert abs(of["speed_forward"][1]) < 0.03


def test_a_joint_that_hardly_moves_says_nothing() -> None:
    rows = machine(n_rows=6000)
    still = rows._replace(nominal=rows.nominal * np.array([1.0, 0.0]))
    values = session_statistics([still], SCALE, 8.0)
    assert np.isfinite(values[0]).all() and np.isnan(values[1]).all()


def test_rows_that_do_not_count_say_nothing() -> None:
    rows = machine()
    counts, velocity = rows.counts.copy(), rows.velocity.copy()
    velocity[1000:1400] += 5.0
    counts[1000:1400] = False
    blind = session_statistics([rows._replace(counts=counts)], SCALE, 8.0)
    np.testing.assert_array_equal(
        session_statistics([rows._replace(counts=counts, velocity=velocity)], SCALE, 8.0), blind
    )


def test_a_log_in_two_stretches_is_one_session() -> None:
    rows = machine()
    halves = [Rows(*(column[of] for column in rows)) for of in (slice(0, 3000), slice(3000, 6000))]
    whole, parts = (session_statistics(of, SCALE, 8.0) for of in ([rows], halves))
    np.testing.assert_allclose(whole, parts, atol=0.01)
