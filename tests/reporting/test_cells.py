"""What `params.yaml` must say of the controllers before pictures and report look for them."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from pipeline.errors import InputError
from pipeline.reporting.results.cells import read_controller_cells
from pipeline.reporting.results.controllers import controllers_of
from tests.stages.command import run_stage

ROOT = Path(__file__).parents[2]
CELLS = {
    "identified": {"mlp_dqdot": {}, "kan_dqdot": {}},
    "models": ["mlp", "kan"],
    "targets": ["dqdot"],
    "seeds": [0, 1],
    "icem_variants": ["icem"],
    "icem_models": ["mlp"],
    "icem_targets": ["dqdot"],
    "icem_seeds": [0],
    "logs": "data/raw/sessions",
}


def written(folder: Path, cells: dict[str, Any]) -> Path:
    path = folder / "params.yaml"
    path.write_text(yaml.safe_dump(cells))
    return path


@pytest.mark.parametrize("path", ["params.yaml", "artifacts/all_kinds/params.yaml"])
def test_the_projects_own_are_read(path: str) -> None:
    assert controllers_of(read_controller_cells(ROOT / path, "identified", "logs"))


def test_without_planners_nothing_is_asked_of_them(tmp_path: Path) -> None:
    cells = {key: value for key, value in CELLS.items() if not key.startswith("icem_")}
    for variants in ({}, {"icem_variants": []}, {"icem_variants": None}):
        assert controllers_of(read_controller_cells(written(tmp_path, cells | variants))) == {
            "apg_mlp_dqdot": [0, 1],
            "apg_kan_dqdot": [0, 1],
            "ppo_warm_mlp_dqdot": [0, 1],
            "ppo_warm_kan_dqdot": [0, 1],
        }


@pytest.mark.parametrize(
    ("key", "remedy"),
    [
        ("icem_models", "`icem_models: [mlp, kan]`"),
        ("icem_targets", "`icem_targets: [dqdot]`"),
        ("icem_seeds", "`icem_seeds: [0]`"),
    ],
)
def test_a_file_from_before_icems_keys_is_told_which_is_missing(
    key: str, remedy: str, tmp_path: Path
) -> None:
    path = written(tmp_path, {name: value for name, value in CELLS.items() if name != key})
    with pytest.raises(InputError) as raised:
        read_controller_cells(path)
    assert f"cells={path}: has icem_variants, but no {key}; add {remedy}" in str(raised.value)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (
            {"models": ["kan"]},
            r"icem_models has \[mlp\], which models has not, so there is no such model; add it",
        ),
        ({"icem_targets": ["dq", "dqdot"]}, r"icem_targets has \[dq\], which targets has not"),
        ({"models": "mlp"}, "models is mlp; it must be a list in square brackets"),
        ({"icem_seeds": 0}, "icem_seeds is 0; it must be a list"),
        ({"icem_variants": "icem"}, "icem_variants is icem; it must be a list"),
    ],
)
def test_what_cannot_be_is_told(changed: dict[str, Any], said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=said):
        read_controller_cells(written(tmp_path, CELLS | changed))


@pytest.mark.parametrize("stage", ["pictures", "report"])
def test_the_stages_say_so_in_one_line(stage: str, tmp_path: Path) -> None:
    written(tmp_path, {name: value for name, value in CELLS.items() if name != "icem_models"})
    refused = run_stage(stage, "cells=params.yaml", folder=tmp_path)
    assert refused.returncode == 2
    (line,) = refused.stderr.splitlines()
    assert line.startswith(f"error: {stage}: cells=params.yaml: has icem_variants, but no icem_models; add")
