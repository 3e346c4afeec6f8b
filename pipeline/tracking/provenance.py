"""What the figures of a page were made from, for its last section."""

from pipeline.tracking.lineage import dvc_hashes
from pipeline.tracking.stage_run import StageRun

DATA = (
    "data/raw/sessions",
    "data/raw/held_out",
    "data/raw/changed/sessions",
    "data/processed/sessions",
    "data/processed/held_out",
)


def data_tags() -> dict[str, str]:
    """DVC's hashes of the data, as tags of the whole pipeline's run."""
    return {f"dvc.{path}": digest for path, digest in dvc_hashes(list(DATA)).items()}


def provenance(profile: str, machine: str, run: StageRun) -> list[tuple[str, str]]:
    """Name and value: profile, machine, DVC's hashes of the data, the MLflow run, the command."""
    return [
        ("profile", f"{profile} (conf/profile/{profile}.yaml)"),
        ("machine", f"{machine} (conf/machine/{machine}.yaml)"),
        *((f"{path} (DVC)", digest) for path, digest in dvc_hashes(list(DATA)).items()),
        ("MLflow run", run.parent_id or run.run_id or "not tracked"),
        ("made by", "make repro"),
    ]
