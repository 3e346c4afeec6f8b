"""Keys of every stage that runs the graph, the library's settings from them, and the commands of its nodes."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import TypeVar

from omegaconf import MISSING

from pipeline.configuration.load import MACHINE_DIRECTORY
from pipeline.configuration.overrides import of_this_job, replaced
from pipeline.configuration.paths import InputModel, InputPath
from pipeline.configuration.reaching import ReachingKeys
from pipeline.control.icem.config import IcemConfig
from pipeline.control.icem.variant import RewardVariant
from pipeline.deployment.compose import GraphSettings
from pipeline.deployment.nodes import AUTONOMOUS, DRIVERS, NODES, Driver, watching
from pipeline.deployment.settings import CoverageConfig, DeploymentConfig
from pipeline.deployment.transports.ros1.can_bus import CanBusConfig
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.errors import InputError
from pipeline.logs.ingest_config import IngestConfig
from pipeline.watch.settings import WatchConfig

S = TypeVar("S", bound=GraphSettings)


@dataclass
class ControllerKeys(ReachingKeys):
    """Keys of every stage whose graph has a controller in it."""

    icem: IcemConfig = MISSING
    deployment: DeploymentConfig = MISSING
    policy: InputModel | None = None
    variant: RewardVariant | None = None


@dataclass
class GraphKeys(ControllerKeys):
    """Keys of every stage that runs the real graph."""

    targets: int = MISSING
    driver: Driver = Driver.simulated
    plant_seed: int = MISSING
    operator_seed: int = MISSING
    plan: InputPath | None = None
    effects: list[str] = field(default_factory=list)
    effects_seed: int = MISSING
    effect_size: float = MISSING
    condition: str = MISSING
    coverage: CoverageConfig = MISSING
    live_port: int | None = None
    ingest: IngestConfig = MISSING
    identify: IdentifyConfig = MISSING
    close_loop: CloseLoopConfig = MISSING
    watch: WatchConfig = MISSING
    watch_state: InputPath | None = None
    can: CanBusConfig = MISSING

    def __post_init__(self) -> None:
        if isinstance(self.targets, int) and self.targets < 1:
            raise InputError(f"targets is {self.targets}; it must be at least 1")

    def check_model(self) -> None:
        """Raise `InputError` where a model has to stand in the machine's place and none is named."""
        if self.driver is not Driver.plant and not self.model:
            raise InputError(
                f"`model` is missing; driver={self.driver} takes model=FOLDER that identify wrote"
            )


def settings_of(kind: type[S], configuration: ControllerKeys) -> S:
    """The library's settings from a stage's keys of the same names."""
    own = {name: getattr(configuration, name) for name in _names(kind) & _names(type(configuration))}
    control = configuration.control
    return kind(
        machine_directory=MACHINE_DIRECTORY,
        action_repeats=control.action_repeats,
        loop_tracker=control.loop_tracker,
        **own,
    )


def node_commands(
    configuration: GraphKeys, overrides: Sequence[str], commanding: Sequence[str] = AUTONOMOUS
) -> dict[str, list[str]]:
    """The commands of all nodes, with those overrides of this command that a node knows.

    Args:
        configuration: Names what stands in the machine's place, and whether somebody watches.
        overrides: Of this command.
        commanding: Nodes that commands come from.
    """
    known = _names(GraphKeys) - {"tracking"} | {"profile"}
    passed = [word for word in overrides if word.lstrip("+~").split("=")[0].split(".")[0] in known]
    command = [sys.executable, "-m", "pipeline.stages.graph_node", *passed]
    names = (*DRIVERS[configuration.driver], *NODES, *commanding, *watching(configuration.watch_state))
    return {name: [*command, f"node={name}"] for name in names}


def commanded_by(configuration: GraphKeys, commanding: Sequence[str]) -> dict[str, list[str]]:
    """The commands of all nodes for this job, of a stage that has another driver and model by default than a node."""
    own = {"driver": configuration.driver, "model": configuration.model}
    return node_commands(configuration, replaced(of_this_job(configuration), own), commanding)


def _names(kind: type) -> set[str]:
    return {one.name for one in fields(kind)}
