"""Each `dvc.yaml` must name everything that a stage reads: code, configuration files, sections of the profiles."""

import dataclasses
import importlib
import re
from functools import cache
from pathlib import Path
from typing import Any

import grimp
import pytest
import yaml

ROOT = Path(__file__).parents[2]
# The frame around a stage decides nothing of its outputs.
FRAME = {
    "pipeline.configuration.graph",
    "pipeline.configuration.load",
    "pipeline.configuration.paths",
    "pipeline.configuration.reaching",
    "pipeline.configuration.stage",
    "pipeline.configuration.training",
    "pipeline.configuration.number_checks",
    "pipeline.configuration.pages",
    "pipeline.files.checkpoint_cleanup",
    "pipeline.files.path_checks",
    "pipeline.tracking",
    "pipeline.errors",
    "pipeline",
    "pipeline.stages",
}


GRAPHS = ("dvc.yaml", "experiments/control_level/dvc.yaml", "experiments/paper_tables/dvc.yaml")


def stages(graph: str = GRAPHS[0]) -> dict[str, dict[str, Any]]:
    content = yaml.safe_load((ROOT / graph).read_text())["stages"]
    return {name: stage.get("do", stage) for name, stage in content.items()}


def modules_of(stage: dict[str, Any]) -> list[str]:
    """Names of the modules in `pipeline/stages` that the stage's commands start."""
    return re.findall(r"-m pipeline\.stages\.(\w+)", str(stage["cmd"]))


every_stage = pytest.mark.parametrize(
    "stage",
    [pytest.param(stage, id=f"{graph}:{name}") for graph in GRAPHS for name, stage in stages(graph).items()],
)


@cache
def import_graph() -> grimp.ImportGraph:
    return grimp.build_graph("pipeline")


def is_bare_package(module: str) -> bool:
    return (ROOT / module.replace(".", "/") / "__init__.py").exists()


def imported_modules(stage: str) -> set[str]:
    """Modules of the library that the stage imports, directly or not, without the frame."""
    graph, found, open_ = import_graph(), set(), [f"pipeline.stages.{stage}"]
    while open_:
        module = open_.pop()
        if module in found or module in FRAME or module.startswith("pipeline.tracking."):
            continue
        found.add(module)
        open_ += graph.find_modules_directly_imported_by(module)
    return found


@every_stage
def test_every_imported_module_is_a_dependency(stage: dict[str, Any]) -> None:
    dependencies = [dep for dep in stage["deps"] if dep.startswith("pipeline/")]
    for module in set[str]().union(*map(imported_modules, modules_of(stage))):
        path = module.replace(".", "/")
        covered = any(f"{path}.py" == dep or f"{path}/".startswith(f"{dep}/") for dep in dependencies)
        assert covered or is_bare_package(module), f"the stage imports {module}, which its deps do not name"


def sections_of(name: str) -> set[str]:
    """Sections of the profile that the stage's configuration has."""
    module = importlib.import_module(f"pipeline.stages.{name}")
    configuration = next(
        value
        for key, value in vars(module).items()
        if dataclasses.is_dataclass(value) and key.lower() == f"{name.replace('_', '')}stage"
    )
    return {
        field.name
        for field in dataclasses.fields(configuration)
        if dataclasses.is_dataclass(field.type) and field.name not in ("machine", "tracking")
    }


@every_stage
def test_every_section_that_a_stage_reads_is_a_parameter(stage: dict[str, Any]) -> None:
    sections = set[str]().union(*map(sections_of, modules_of(stage)))
    files = {
        path: keys
        for entry in stage.get("params", [])
        if isinstance(entry, dict)
        for path, keys in entry.items()
    }
    assert "conf/machine/${machine}.yaml" in files
    base = {key.split(".")[0] for key in files.get("conf/profile/paper.yaml", [])}
    assert sections == base, f"the stage reads {sections}, its params name {base} of the paper's profile"
    overrides = set(files.get("conf/profile/${profile}.yaml", []))
    for profile in ("default", "smoke"):
        content = yaml.safe_load((ROOT / f"conf/profile/{profile}.yaml").read_text())
        assert overrides <= set(content)
        assert sections & set(content) <= overrides, f"the stage ignores a section of profile {profile}"


@every_stage
def test_the_stage_and_its_configuration_are_dependencies(stage: dict[str, Any]) -> None:
    names = modules_of(stage)
    assert names
    for name in names:
        assert {f"pipeline/stages/{name}.py", f"conf/{name}.yaml"} <= set(stage["deps"])


def test_only_pages_depend_on_how_results_are_told() -> None:
    """A reworded sentence must not rerun the search."""
    told = {name for name, content in stages().items() if "pipeline/reporting" in content["deps"]}
    assert told == {"quality_page", "judgement_page", "loop_page", "pictures", "report"}
