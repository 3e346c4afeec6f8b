"""Stage `repair`: a deployed policy is trained further on a model with effects, and compared with what it was."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

from omegaconf import MISSING

from pipeline.configuration.paths import InputModel
from pipeline.configuration.reaching import ReachingKeys
from pipeline.configuration.stage import stage
from pipeline.control.apg.config import APGConfig
from pipeline.control.repair.config import RepairConfig
from pipeline.control.repair.files import write_note, write_repair
from pipeline.control.repair.repair import repair
from pipeline.effects.store import load_active
from pipeline.files.path_checks import Output
from pipeline.tracking import StageRun, flatten_metrics

say = partial(print, "repair:", flush=True)  # at once


@dataclass
class RepairStage(ReachingKeys):
    """Keys of `conf/repair.yaml`."""

    policy: InputModel = MISSING
    output: Annotated[str, Output(replaced=("policy", "former"))] = MISSING
    apg: APGConfig = MISSING
    policy_repair: RepairConfig = MISSING
    seed: int = MISSING
    allow_empty: bool = False


@stage(RepairStage)
def main(configuration: RepairStage, run: StageRun) -> None:
    """Write the new policy, the former one, and `repair.json`."""
    policy, model, output = (Path(getattr(configuration, key)) for key in ("policy", "model", "output"))
    run.inputs(f"{model}/parameters.msgpack", f"{model}/effects.json", f"{policy}/policy.msgpack")
    if configuration.allow_empty and load_active(model) is None:
        say(write_note(output, f"{model} has no effects around it"))
        return
    config = configuration.policy_repair
    of_training = configuration.reaching, configuration.apg, config, configuration.seed
    repaired = repair(policy, model, *of_training, lambda point: say(point.shown))
    if repaired.is_certain:
        say(f"{model} says of no value how far it may be off: each is taken as known")
    document = write_repair(output, repaired, policy, config.margin)
    shown = (f"{100 * document[name]:.1f} %" for name in ("sr_before", "sr_after"))
    say(f"success {' to '.join(shown)} on the model; {document['reason']}")
    run.metrics(flatten_metrics(document["on_model"]))
    run.artifact(output, "repair")


if __name__ == "__main__":
    main()
