"""Typed configuration and the frame that every stage runs in.

Hydra composes `conf/<stage>.yaml` (machine, profile, tracking, the stage's own keys) and validates it against the
stage's dataclass; ranges are checked when the dataclasses are built, before any work starts.
"""

import contextlib
import functools
import os
import signal
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import hydra
import yaml
from hydra.core.config_store import ConfigStore
from hydra.core.hydra_config import HydraConfig
from hydra.errors import CompactHydraException
from hydra.types import RunMode
from omegaconf import MISSING, DictConfig, MissingMandatoryValue, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from pipeline.configuration.help_text import help_text
from pipeline.configuration.load import CONFIGURATION_DIRECTORY
from pipeline.configuration.number_checks import check_numbers
from pipeline.configuration.paths import check_paths
from pipeline.errors import InputError, first_line
from pipeline.files.path_checks import refuse_unusable
from pipeline.machine.specification import MachineSpecification
from pipeline.tracking import StageRun, TrackingConfiguration, track

CONFIGURATION_FILE = "configuration.yaml"  # in Hydra's run folder: what was run, resolved
INPUT_ERROR_STATUS = 2


@dataclass
class PipelineConfiguration:
    """What every stage shares. A stage's own class types the sections that it reads; the others pass untyped.

    Its keys of the types in `pipeline.configuration.paths` are inputs and outputs, and checked as such.
    """

    machine: MachineSpecification = MISSING
    tracking: TrackingConfiguration = MISSING
    profile: str = "${hydra:runtime.choices.profile}"
    control: Any = MISSING
    record: Any = MISSING
    record_changed: Any = MISSING
    ingest: Any = MISSING
    identify: Any = MISSING
    episodes: Any = MISSING
    coverage: Any = MISSING
    reward: Any = MISSING
    ppo: Any = MISSING
    warm_start: Any = MISSING
    apg: Any = MISSING
    policy_repair: Any = MISSING
    reward_ablation: Any = MISSING
    icem: Any = MISSING
    search: Any = MISSING
    judge: Any = MISSING
    close_loop: Any = MISSING
    watch: Any = MISSING
    deployment: Any = MISSING


def stage(
    configuration: type[PipelineConfiguration],
) -> Callable[[Callable[[Any, StageRun], None]], Callable[[], None]]:
    """Turn `function(configuration, run)` into a command with Hydra's overrides and multirun.

    The command's name is the module's, and so is its configuration file's. `InputError` becomes one line on standard
    error and exit status 2.
    """

    def decorate(function: Callable[[Any, StageRun], None]) -> Callable[[], None]:
        name = Path(function.__code__.co_filename).stem
        ConfigStore.instance().store(name=f"{name}_schema", node=configuration)

        @functools.wraps(function)
        def job(composed: DictConfig) -> None:
            with _failing_in_one_line(name):
                typed = check(composed)
                check_paths(typed)
                resolved: Any = OmegaConf.to_container(composed, resolve=True)
                text = OmegaConf.to_yaml(composed, resolve=True)
                run_folder = Path(HydraConfig.get().runtime.output_dir)
                (run_folder / CONFIGURATION_FILE).write_text(text, encoding="utf-8")
                unread = [
                    key for key in resolved if isinstance(getattr(typed, key), dict)
                ]  # sections left untyped
                with track(name, typed.tracking, resolved, text, _sweep(), unread) as run:
                    function(typed, run)

        main = hydra.main(version_base="1.3", config_path=str(CONFIGURATION_DIRECTORY), config_name=name)(job)

        @functools.wraps(function)
        def command() -> None:
            if "--help" in sys.argv:
                does = sys.modules[function.__module__].__doc__ or ""
                print(help_text(name, does, CONFIGURATION_DIRECTORY), end="")
                return
            _check_run_folder(name)
            os.environ["HYDRA_FULL_ERROR"] = "1"  # or Hydra tells what it refuses by itself, in four lines
            try:
                main()
            except (CompactHydraException, yaml.YAMLError) as error:
                _tell_refusal(name, error)

        return command

    return decorate


def _check_run_folder(name: str) -> None:
    """Exit in one line if Hydra could not make its run folder, which it tells by a traceback."""
    if any("hydra." in argument for argument in sys.argv[1:]):  # the folder is another
        return
    try:
        refuse_unusable("hydra.run.dir", "runs", is_file=False)
    except InputError as error:
        print(f"error: {name}: {error}", file=sys.stderr, flush=True)
        sys.exit(INPUT_ERROR_STATUS)


def _tell_refusal(name: str, error: CompactHydraException | yaml.YAMLError) -> NoReturn:
    """Say in one line what Hydra refuses, without where it has looked for it, or what is not YAML, and where."""
    what, *_ = str(error).split("\n\nConfig search path")
    if error.__cause__ is not None:
        what = f"{first_line(error).rstrip('.')}: {first_line(error.__cause__)}"
    print(f"error: {name}: {' '.join(what.split())}", file=sys.stderr, flush=True)
    sys.exit(INPUT_ERROR_STATUS)


def _sweep() -> tuple[str, str] | None:
    """Of a sweep's job, what tells the sweep from others and the job from the sweep's others."""
    hydra_configuration = HydraConfig.get()
    if hydra_configuration.mode is not RunMode.MULTIRUN:
        return None
    return str(Path(hydra_configuration.sweep.dir).absolute()), hydra_configuration.job.override_dirname


def check(composed: DictConfig) -> Any:
    """A composed configuration as the stage's dataclass, whose ranges are checked as it is built.

    Raises:
        InputError: A value is missing or out of its range.
    """
    try:
        _check_machine_name(composed)
        configuration = OmegaConf.to_object(composed)
        resolved = OmegaConf.to_container(composed, resolve=True)
    except MissingMandatoryValue as error:
        key = str(error.full_key)
        place = HydraConfig.get().runtime.choices["machine"]
        remedy = (
            f"set it in conf/machine/{place}.yaml"
            if key.startswith("machine.")
            else f"add {key}=VALUE to the command"
        )
        raise InputError(f"`{key}` is missing; {remedy}") from error
    except OmegaConfBaseException as error:
        line = first_line(error)
        raise InputError(f"`{error.full_key}`: {line}; correct it on the command line or in conf/") from error
    check_numbers(resolved)
    _check_checkpoints(getattr(configuration, "checkpoints", None), getattr(configuration, "output", None))
    return configuration


def _check_checkpoints(folder: str | None, output: str | None) -> None:
    """A finished run deletes its checkpoints; by `output=../x` their default would be the folder `x`."""
    if folder is None:
        return
    if ".." in Path(folder).parts:
        raise InputError(
            f"checkpoints={folder}: leads out of its own folder, and checkpoints are deleted once the run is finished; "
            "add checkpoints=FOLDER to the command, or give output without .."
        )
    if output is not None and Path(os.path.realpath(output)).is_relative_to(os.path.realpath(folder)):
        raise InputError(
            f"checkpoints={folder}: holds output={output}, and checkpoints are deleted once the run is finished; "
            "name another folder"
        )


def _check_machine_name(composed: DictConfig) -> None:
    chosen = HydraConfig.get().runtime.choices["machine"]
    if composed.machine.name != chosen:
        raise InputError(
            f"conf/machine/{chosen}.yaml: name is {composed.machine.name}; it must be the file's, {chosen}"
        )


class JobError(Exception):
    """What ended a sweep's job: a line for the user, and the exit status of the sweep."""

    def __init__(self, line: str, status: int) -> None:
        super().__init__(line, status)
        self.line = line
        self.status = status


@contextlib.contextmanager
def _failing_in_one_line(name: str) -> Iterator[None]:
    """Turn a user's mistake into one line and an exit status, in a sweep without ending the jobs beside."""
    try:
        yield
    except InputError as error:
        _fail(f"{name}: {error}", INPUT_ERROR_STATUS)
    except OSError as error:
        place = error.filename or "input or output"
        line = f"{name}: {place}: {error.strerror or error}; check the path, permissions and room"
        _fail(line, INPUT_ERROR_STATUS)
    except KeyboardInterrupt:
        print(f"error: {name}: interrupted; start it again to go on", file=sys.stderr, flush=True)
        sys.exit(128 + signal.SIGINT)


def _fail(line: str, status: int) -> NoReturn:
    if HydraConfig.get().mode is RunMode.MULTIRUN:
        raise JobError(line, status)  # which Hydra hands to the sweeper, from whatever process
    print(f"error: {line}", file=sys.stderr, flush=True)
    sys.exit(status)
