"""Hydra's own sweeper, which checks every job's configuration before the first job starts.

Hydra composes all jobs before the first launch, and so refuses invalid names and types at once. It would find ranges
and missing values only at the start of a job, hours into a sweep. Hydra loads plugins from the package
`hydra_plugins` only.
"""

import sys
from collections.abc import Sequence
from typing import Any

from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from pipeline.configuration.paths import check_paths
from pipeline.configuration.stage import INPUT_ERROR_STATUS, JobError, check
from pipeline.errors import InputError


class CheckedSweeper(BasicSweeper):
    """A failed job does not stop the others; the sweep then ends with its message and status."""

    def sweep(self, arguments: list[str]) -> Any:
        """Run the sweep; see Hydra's."""
        assert self.config is not None
        try:
            return super().sweep(arguments)
        except InputError as error:  # in a configuration, before any job has started
            print(f"error: {self.config.hydra.job.name}: {error}", file=sys.stderr, flush=True)
            sys.exit(INPUT_ERROR_STATUS)
        except JobError as error:
            print(f"error: {error.line}", file=sys.stderr, flush=True)
            sys.exit(error.status)

    def validate_batch_is_legal(self, batch: Sequence[Sequence[str]]) -> None:
        """Compose and check the configuration of every job."""
        assert self.hydra_context is not None and self.config is not None
        own = HydraConfig.instance().cfg
        try:
            for overrides in batch:
                composed = self.hydra_context.config_loader.load_sweep_config(self.config, list(overrides))
                HydraConfig.instance().set_config(composed)
                check_paths(check(_without_hydra(composed)))
        finally:
            HydraConfig.instance().cfg = own


def _without_hydra(composed: DictConfig) -> DictConfig:
    """The configuration as a job sees it."""
    kept = composed.copy()
    kept._set_flag("struct", False)
    del kept["hydra"]
    return kept
