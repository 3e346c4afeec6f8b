"""`dvc.yaml` must name everything that a stage reads: code, configuration files, sections of the profiles."""

import dataclasses
import importlib
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
    "pipeline.configuration.number_checks",
    "pipeline.configuration.pages",
    "pipeline.files.checkpoint_cleanup",
    "pipeline.files.path_checks",
    "pipeline.tracking",
    "pipeline.errors",
    "pipeline",
    "pipeline.stages",
}


def stages() -> dict[str, dict[str, Any]]:
    graph = yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"]
    return {name: content.get("do", content) for name, content in graph.items()}


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


@pytest.mark.parametrize("name", stages())
def test_every_imported_module_is_a_dependency(name: str) -> None:
    dependencies = [dep for dep in stages()[name]["deps"] if dep.startswith("pipeline/")]
    for module in imported_modules(name):
        path = module.replace(".", "/")
        covered = any(f"{path}.py" == dep or f"{path}/".startswith(f"{dep}/") for dep in dependencies)
        assert covered or is_bare_package(module), (
            f"stage {name} imports {module}, which dvc.yaml does not name"
        )


@pytest.mark.parametrize("name", stages())
def test_every_section_that_a_stage_reads_is_a_parameter(name: str) -> None:
    module = importlib.import_module(f"pipeline.stages.{name}")
    configuration = next(
        value
        for key, value in vars(module).items()
        if dataclasses.is_dataclass(value) and key.lower() == f"{name.replace('_', '')}stage"
    )
    sections = {
        field.name
        for field in dataclasses.fields(configuration)
        if dataclasses.is_dataclass(field.type) and field.name not in ("machine", "tracking")
    }
    files = {
        path: keys
        for entry in stages()[name].get("params", [])
        if isinstance(entry, dict)
        for path, keys in entry.items()
    }
    assert "conf/machine/${machine}.yaml" in files
    base = {key.split(".")[0] for key in files.get("conf/profile/paper.yaml", [])}
    assert sections == base, f"stage {name} reads {sections}, dvc.yaml names {base} of the paper's profile"
    overrides = set(files.get("conf/profile/${profile}.yaml", []))
    for profile in ("default", "smoke"):
        content = yaml.safe_load((ROOT / f"conf/profile/{profile}.yaml").read_text())
        assert overrides <= set(content)
        assert sections & set(content) <= overrides, f"stage {name} ignores a section of profile {profile}"


@pytest.mark.parametrize("name", stages())
def test_the_stage_and_its_configuration_are_dependencies(name: str) -> None:
    dependencies = stages()[name]["deps"]
    assert f"pipeline/stages/{name}.py" in dependencies
    assert f"conf/{name}.yaml" in dependencies


def test_only_pages_depend_on_how_results_are_told() -> None:
    """A reworded sentence must not rerun the search."""
    told = {name for name, content in stages().items() if "pipeline/reporting" in content["deps"]}
    assert told == {"quality_page", "judgement_page", "loop_page", "pictures", "report"}
