import numpy as np
import polars
import pytest

from pipeline.errors import InputError
from pipeline.logs.trajectories import first_validation_row
from pipeline.logs.tuples import Trajectory, columns, read_tuples, thinned_positions, write_tuples


def make(name, machine, n=20, seed=0):
    rng = np.random.default_rng(seed)
    q, qd = rng.normal(size=(2, n, machine.n_joint))
    a = rng.integers(-1, 2, (n, machine.n_joint)).astype(float)
    stamp = 1_700_000_000_000_000_001 + np.arange(n) * 50_000_000
    return Trajectory(
        name, np.arange(n) * 0.05, stamp, q, qd, a, np.arange(n) >= first_validation_row(n, 0.1)
    )


def test_round_trip_keeps_every_bit(tmp_path, machine):
    written = [make("b", machine, seed=1), make("b#1", machine, n=7, seed=2), make("a", machine, seed=3)]
    write_tuples(tmp_path / "b.parquet", machine, written[:2])
    write_tuples(tmp_path / "a.parquet", machine, written[2:])
    read = read_tuples(tmp_path, machine)
    assert [trajectory.name for trajectory in read] == ["a", "b", "b#1"]
    for before, after in zip([written[2], *written[:2]], read, strict=True):
        for field in ("t_s", "stamp_ns", "q", "qd", "a", "is_validation"):
            np.testing.assert_array_equal(getattr(before, field), getattr(after, field))


def test_columns_are_the_contracts(tmp_path, machine):
    path = tmp_path / "a.parquet"
    write_tuples(path, machine, [make("a", machine)])
    frame = polars.read_parquet(path)
    joints = ["swing", "boom", "arm", "bucket"]
    values = [f"{prefix}_{joint}" for prefix in ("q", "qd", "a") for joint in joints]
    channels = ["x_oil_temperature", "x_pump_pressure", "x_engine_speed"]
    expected = ["trajectory", "t", "stamp", *values, *channels, "split"]
    assert frame.columns == expected == columns(machine)
    assert frame["split"].to_list() == ["train"] * 18 + ["validation"] * 2


def test_same_tuples_give_same_bytes(tmp_path, machine):
    first, second = tmp_path / "1" / "a.parquet", tmp_path / "2" / "a.parquet"
    for path in (first, second):
        write_tuples(path, machine, [make("a", machine, n=500)])
    assert first.read_bytes() == second.read_bytes()
    assert [path.name for path in first.parent.iterdir()] == ["a.parquet"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda frame: frame.drop("qd_arm"), "column qd_arm is missing"),
        (lambda frame: frame.with_columns(split=polars.lit("test")), "column split holds `test`"),
        (lambda frame: frame.with_columns(q_arm=polars.lit(float("nan"))), "column q_arm has missing"),
        (lambda frame: frame.with_columns(a_arm=polars.lit("left")), "column a_arm holds String"),
    ],
)
def test_foreign_tables_are_refused_in_one_line(tmp_path, machine, change, words):
    path = tmp_path / "a.parquet"
    write_tuples(path, machine, [make("a", machine)])
    change(polars.read_parquet(path)).write_parquet(path)
    with pytest.raises(InputError, match=words) as error:
        read_tuples(tmp_path, machine)
    assert str(path) in str(error.value) and "\n" not in str(error.value)


def test_no_tuples_and_no_parquet(tmp_path, machine):
    with pytest.raises(InputError, match="no tuples"):
        read_tuples(tmp_path, machine)
    (tmp_path / "x.parquet").write_bytes(b"not parquet")
    with pytest.raises(InputError, match=r"x\.parquet: not a readable Parquet file"):
        read_tuples(tmp_path, machine)


@pytest.mark.parametrize("maximum_rows", [1, 7, 100, 5000])
def test_thinned_positions_are_every_nth_row(tmp_path, machine, monkeypatch, maximum_rows):
    monkeypatch.setattr("pipeline.logs.tuples.ROW_GROUP_ROWS", 64)
    pieces = [make("a", machine, n=50, seed=seed) for seed in range(20)]
    write_tuples(tmp_path / "a.parquet", machine, pieces)
    q = np.concatenate([piece.q for piece in pieces])
    stride = -(-len(q) // maximum_rows)
    thinned = thinned_positions(tmp_path / "a.parquet", machine, maximum_rows)
    np.testing.assert_array_equal(thinned, q[::stride])
