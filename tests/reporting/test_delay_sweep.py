"""Table and figure of a sweep of delays."""

import json
from xml.etree import ElementTree

import numpy as np
import pytest

from pipeline.reporting.figures.delay_sweep import delay_sweep_figure
from pipeline.reporting.tables.delay_sweep import delay_sweep_table

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture
def swept():
    random = np.random.default_rng(0)
    names = ("sr_002_002", "sr_004_004", "sr_012_008", "oow", "path_length_m")
    return {
        delay_s: dict(zip(names, random.random(len(names)).tolist(), strict=True)) | {"n_episodes": 20}
        for delay_s in (0.0, 0.07, 0.3)
    }


def test_a_row_per_delay_in_milliseconds_with_its_own_metrics(swept):
    rows = json.loads(delay_sweep_table(swept).json())["rows"]
    assert [row["Added [ms]"] for row in rows] == ["0", "70", "300"]
    for row, metrics in zip(rows, swept.values(), strict=True):
        assert float(row["SR(0.02, 0.02)"]) == pytest.approx(metrics["sr_002_002"], abs=0.005)
        assert float(row["OOW"]) == pytest.approx(metrics["oow"], abs=0.005)
        assert float(row["EEF-PL [m]"]) == pytest.approx(metrics["path_length_m"], abs=0.005)


def test_the_figure_marks_every_delay_once_per_metric(swept):
    picture = ElementTree.fromstring(delay_sweep_figure(swept))
    within = [group for group in picture.iter(f"{SVG}g") if group.attrib.get("clip-path")]
    assert sum(len(list(group.iter(f"{SVG}use"))) for group in within) == 5 * len(swept)
