"""A short run of the byte-level fuzzer, the same each time; long ones: `python -m tests.logs.fuzz`."""

import random

import pytest

from tests.logs import fuzz

INPUTS_PER_FORMAT = 12


@pytest.fixture(scope="module")
def seeds(tmp_path_factory, machine):
    return fuzz.corpus(tmp_path_factory.mktemp("corpus"), machine)


def test_seeds_are_read(seeds, tmp_path, machine):
    assert {"bz2.bag", "idl.mcap", "by_file_mcap.mcap.zstd", "by_message_sqlite3.db3"} <= seeds.keys()
    for name, content in seeds.items():
        (tmp_path / name).write_bytes(content)
        assert fuzz.try_reading(tmp_path / name, machine) == "read"


def test_damaged_inputs_end_in_a_log_or_one_line(seeds, tmp_path, machine):
    outcomes = set()
    for name in sorted(seeds):
        rng = random.Random(name)
        for _ in range(INPUTS_PER_FORMAT):
            path = tmp_path / name
            path.write_bytes(fuzz.damage(name, seeds[name], rng))
            outcomes.add(fuzz.try_reading(path, machine))
    assert outcomes == {"read", "recovered with notes", "refused"}
