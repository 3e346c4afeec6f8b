"""The nodes of the ROS 1 graph, and the settings that they share."""

import enum
from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.deployment.components.scripted_joystick import ScriptedJoystick
from pipeline.deployment.compose import GraphSettings
from pipeline.deployment.settings import CoverageConfig
from pipeline.deployment.transports.ros1.can_bus import CanBusConfig
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.logs.ingest_config import IngestConfig
from pipeline.watch.settings import WatchConfig
from pipeline.watch.watch_inputs import WatchSettings

NODES = ("control_interface", "control_supervisor")
AUTONOMOUS = ("autonomous_server",)
TELEOPERATED = ("teleoperation_server",)
JOYSTICK = ScriptedJoystick.name
OPERATOR = "operator"  # gives the targets
WATCH = "machine_watch"


class Driver(enum.StrEnum):
    """What stands in the machine's place."""

    simulated = "simulated"  # bobcat_e10_sim_driver with the learned model
    plant = "plant"  # bobcat_e10_sim_driver with the plant, a stand-in for the excavator
    can = "can"  # the machine's own drivers; at the other end of the bus a simulated PLC


DRIVERS = {
    Driver.simulated: ("bobcat_e10_sim_driver",),
    Driver.plant: ("bobcat_e10_sim_driver",),
    Driver.can: ("plc", "emcb_200u_driver", "bobcat_e10_driver"),
}
KNOWN_NODES = (
    *(*NODES, *AUTONOMOUS, *TELEOPERATED, JOYSTICK),
    *(*DRIVERS[Driver.simulated], *DRIVERS[Driver.can], OPERATOR, WATCH),
)


@dataclass(frozen=True, kw_only=True)
class NodeSettings(GraphSettings):
    """What the nodes are built from.

    Attributes:
        targets: How many of the evaluation's targets are pursued.
        plant_seed: Of the plant's process variation and its encoders' noise.
        operator_seed: Of the scripted joystick.
        coverage: Cells of W+ in a live view.
        live_port: Of a live view; None: nobody watches.
        plan: File of an experiment that the scripted operator plays; None: none.
        effects: What has changed in the plant, drawn with `effects_seed` and `effect_size` as `record_changed` does.
        condition: Of the plant: workshop or field.
        watch_state: Folder that `watch` keeps; None: nobody watches.
    """

    ingest: IngestConfig
    identify: IdentifyConfig
    close_loop: CloseLoopConfig
    watch: WatchConfig
    targets: int
    driver: Driver
    plant_seed: int
    operator_seed: int
    can: CanBusConfig
    coverage: CoverageConfig
    live_port: int | None = None
    plan: str | None = None
    effects: Sequence[str] = ()
    effects_seed: int = 0
    effect_size: float = 1.0
    condition: str = "workshop"
    watch_state: str | None = None

    @property
    def watching(self) -> tuple[str, ...]:
        """Nodes that only watch."""
        return watching(self.watch_state)

    @property
    def watch_settings(self) -> WatchSettings:
        """As the command `watch` has them."""
        sections = self.ingest, self.loop_tracker, self.identify, self.close_loop, self.watch
        return WatchSettings(self.machine, *sections)


def watching(watch_state: str | None) -> tuple[str, ...]:
    """Nodes that only watch, where there is a state to watch by."""
    return (WATCH,) if watch_state else ()
