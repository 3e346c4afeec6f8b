"""Pages made from files alone are the pages that are made from what was computed."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from pipeline.discrepancy.experiment.plan import FILE
from pipeline.discrepancy.verdict.files import DOCUMENT, REPORT_DATA, LoopReport
from pipeline.errors import InputError
from pipeline.files.record_file import load_record, save_record
from pipeline.reporting.closed_loop.report import closed_loop_page
from pipeline.reporting.pages import closed_loop, experiment
from tests.discrepancy.experiment.test_plan import MACHINE, PLAN
from tests.reporting.test_closed_loop import documents, evidence_of


@pytest.mark.parametrize("name", documents())
def test_the_loop_page_is_made_from_files(name: str, tmp_path: Path) -> None:
    document = documents()[name]
    report = LoopReport("machine", "old", "new", evidence_of(document))
    save_record(tmp_path / REPORT_DATA, report)
    (tmp_path / DOCUMENT).write_text(json.dumps(document))
    closed_loop.write(tmp_path, MACHINE)
    expected = closed_loop_page(document, report.data, "machine", "old", "new")
    assert (tmp_path / closed_loop.NAME).read_text() == expected


def test_without_measured_logs_the_page_has_the_note(tmp_path: Path) -> None:
    save_record(tmp_path / REPORT_DATA, LoopReport("machine", "old", "new", None))
    (tmp_path / DOCUMENT).write_text(json.dumps({"note": "new holds no logs"}))
    closed_loop.write(tmp_path, MACHINE)
    assert "new holds no logs." in (tmp_path / closed_loop.NAME).read_text()


def test_an_operator_reads_what_the_plan_says_and_how_often(tmp_path: Path) -> None:
    dataclasses.replace(PLAN, steps=[*PLAN.steps] * 3).write(tmp_path / FILE)
    experiment.write(tmp_path, MACHINE)
    page = (tmp_path / experiment.NAME).read_text()
    for said in (
        "these 4 steps 3 times",
        "lift 0.40 rad, turn -0.30 rad",
        "Hold lift +1",
        "0.50",
        "delay (lift)",
        "7.5",
    ):
        assert said in page, said
    (tmp_path / FILE).unlink()
    experiment.write(tmp_path, MACHINE)
    assert not (tmp_path / experiment.NAME).exists()  # that of an earlier run


def test_a_record_comes_back_exactly(tmp_path: Path) -> None:
    report = LoopReport("machine", "old", "new", evidence_of(documents()["named"]))
    first, second = tmp_path / "first.npz", tmp_path / "second.npz"
    save_record(first, report)
    loaded = load_record(first, LoopReport)
    save_record(second, loaded)
    assert first.read_bytes() == second.read_bytes()
    assert report.data is not None and loaded.data is not None
    assert loaded.data.tracks[0].purpose.dtype == np.int8
    np.testing.assert_array_equal(loaded.data.floor, report.data.floor)


def test_files_that_are_not_records_are_told_of(tmp_path: Path) -> None:
    path = tmp_path / REPORT_DATA
    with pytest.raises(InputError, match="no such file"):
        load_record(path, LoopReport)
    path.write_bytes(b"PK")
    with pytest.raises(InputError, match="does not hold the expected record"):
        load_record(path, LoopReport)
