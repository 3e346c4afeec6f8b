"""Learn to move a hydraulic arm from its teleoperation logs, and check its model against measured data.

From Python (`pipeline.configuration.from_python` describes each function)::

    from pipeline import load_machine, read_logs, ingest, identify, evaluate, train_policy, plan, close_loop

The layers, each of which imports only what stands to its left (checked by `lint-imports`, see `.importlinter`)::

    errors < files < machine < logs < dynamics < effects < discrepancy < reaching < control < deployment < reporting
        < study < tracking < configuration < stages
    machine < plant (the simulated machine: nothing that learns may import it) < testbench < stages
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pipeline.configuration.from_python import (
        close_loop,
        evaluate,
        identify,
        ingest,
        plan,
        read_logs,
        train_policy,
    )
    from pipeline.configuration.load import load_machine, load_section
    from pipeline.errors import InputError

__all__ = [
    "InputError",
    "close_loop",
    "evaluate",
    "identify",
    "ingest",
    "load_machine",
    "load_section",
    "plan",
    "read_logs",
    "train_policy",
]

_MODULES = {
    "InputError": "pipeline.errors",
    "load_machine": "pipeline.configuration.load",
    "load_section": "pipeline.configuration.load",
}


def __getattr__(name: str) -> Any:
    """Import what is asked for, so that `import pipeline` takes no time (PEP 562)."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_MODULES.get(name, "pipeline.configuration.from_python")), name)
