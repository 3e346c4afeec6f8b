import numpy as np
import polars
import pytest

from pipeline.errors import InputError
from pipeline.logs.trajectories import validation_rows
from pipeline.logs.tuples import Trajectory, columns, read_tuples, write_tuples


def make(name, machine, n=20, seed=0):
    rng = np.random.default_rng(seed)
    q, qd = rng.normal(size=(2, n, machine.n_joint))
    a = rng.integers(-1, 2, (n, machine.n_joint)).astype(float)
    stamp = 1_700_000_000_000_000_001 + np.arange(n) * 50_000_000
    return Trajectory(name, np.arange(n) * 0.05, stamp, q, qd, a, validation_rows(n, 0.1))


def test_round_trip_keeps_every_bit(tmp_path, machine):
    written = [make("b", machine, seed=1), make("b#1", machine, n=7, seed=2), make("a", machine, seed=3)]
    paths = write_tuples(tmp_path, machine, written)
    assert sorted(path.name for path in paths) == ["a.parquet", "b.parquet"]
    read = read_tuples(tmp_path, machine)
    assert [trajectory.name for trajectory in read] == ["a", "b", "b#1"]
    for before, after in zip([written[2], *written[:2]], read, strict=True):
        for field in ("t_s", "stamp_ns", "q", "qd", "a", "is_validation"):
            np.testing.assert_array_equal(getattr(before, field), getattr(after, field))


def test_columns_are_the_contracts(tmp_path, machine):
    (path,) = write_tuples(tmp_path, machine, [make("a", machine)])
    frame = polars.read_parquet(path)
    joints = ["swing", "boom", "arm", "bucket"]
    expected = ["trajectory", "t", "stamp", *[f"{p}_{j}" for p in ("q", "qd", "a") for j in joints], "split"]
    assert frame.columns == expected == columns(machine)
    assert frame["split"].to_list() == ["train"] * 18 + ["validation"] * 2


def test_same_tuples_give_same_bytes(tmp_path, machine):
    (first,) = write_tuples(tmp_path / "1", machine, [make("a", machine, n=500)])
    (second,) = write_tuples(tmp_path / "2", machine, [make("a", machine, n=500)])
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
    (path,) = write_tuples(tmp_path, machine, [make("a", machine)])
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
