"""Machines and sections of profiles from `conf/`, checked as every stage checks them, for use from Python too."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml
from omegaconf import Container, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from pipeline.configuration.number_checks import check_numbers
from pipeline.errors import InputError, first_line
from pipeline.logs.loop_tracker import LoopTrackerConfig
from pipeline.machine.specification import MACHINE_DIRECTORY, MachineSpecification

CONFIGURATION_DIRECTORY = MACHINE_DIRECTORY.parent


@dataclass
class ControlConfiguration:
    """Section `control` of a profile: the rate at which commands are decided, and the velocity estimator."""

    action_repeats: int
    loop_tracker: LoopTrackerConfig

    def __post_init__(self) -> None:
        if self.action_repeats < 1:
            raise InputError(f"control.action_repeats is {self.action_repeats}; it must be at least 1")


def load_machine(name: str) -> MachineSpecification:
    """Read `conf/machine/<name>.yaml` as every stage does, for use from Python.

    Raises:
        InputError: There is no such machine, or its description is not valid.
    """
    path = MACHINE_DIRECTORY / f"{name}.yaml"
    if not path.exists():
        known = ", ".join(sorted(file.stem for file in MACHINE_DIRECTORY.glob("*.yaml")))
        raise InputError(f"{path}: no such machine; use one of {known}, or describe it there")
    return _typed(MachineSpecification, _content(path), path)


def load_section(section: str, schema: type, profile: str = "paper") -> Any:
    """Read a section of a profile, over the paper's values, as every stage does, for use from Python.

    Raises:
        InputError: There is no such profile, or a value is not valid.
    """
    folder = CONFIGURATION_DIRECTORY / "profile"
    if not (folder / f"{profile}.yaml").exists():
        known = ", ".join(sorted(file.stem for file in folder.glob("*.yaml")))
        raise InputError(f"profile {profile} is not known; use one of {known}")
    contents = [_content(folder / f"{name}.yaml") for name in dict.fromkeys(("paper", profile))]
    merged = OmegaConf.merge(*(OmegaConf.select(content, section) or {} for content in contents))
    check_numbers(OmegaConf.to_container(merged), section)
    return _typed(schema, merged, folder / f"{profile}.yaml")


def _content(path: Path) -> Container:
    """What a file holds, not to be changed. A file as it was is not parsed again, which takes some 40 ms."""
    return _parsed(path, path.stat().st_mtime_ns)


@lru_cache(maxsize=32)
def _parsed(path: Path, modified_ns: int) -> Container:
    try:
        return OmegaConf.load(path)
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not YAML ({error})") from error


def _typed(schema: type, content: Any, place: Path) -> Any:
    try:
        return OmegaConf.to_object(OmegaConf.merge(OmegaConf.structured(schema), content))
    except OmegaConfBaseException as error:
        raise InputError(f"{place}: {first_line(error)}") from error
