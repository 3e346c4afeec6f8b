"""From an artifact to its runs: `python -m pipeline.tracking PATH` lists the runs that wrote or read it.

In the other direction, a run's tags `output.<path>` and `input.<path>` hold DVC's hashes of what it wrote and read.
"""

import argparse
import os
import sys
import time
from pathlib import Path
from typing import Any

from pipeline.errors import InputError
from pipeline.tracking.configuration import TrackingConfiguration
from pipeline.tracking.lineage import content_hash
from pipeline.tracking.stage_run import shown_path, tag_name
from pipeline.tracking.store import end_killed_runs, open_store

DEFAULT_STORE = "sqlite:///mlflow.db"


def main(arguments: list[str] | None = None) -> int:
    """Print a line per run."""
    parser = argparse.ArgumentParser(prog="python -m pipeline.tracking", description=__doc__)
    parser.add_argument("path", help="a file or folder that a stage wrote or read")
    parser.add_argument(
        "--uri", default=os.environ.get("MLFLOW_TRACKING_URI", DEFAULT_STORE), help="tracking store"
    )
    given = parser.parse_args(arguments)
    try:
        lines = runs_of(given.path, given.uri)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print("\n".join(lines))
    return 0


def runs_of(path: str, uri: str) -> list[str]:
    """The runs that wrote or read the present content of a path, newest first, a line each.

    Raises:
        InputError: The path is missing, or the store does not answer.
    """
    digest = content_hash(Path(path))
    if digest is None:
        raise InputError(f"{path}: no such file or folder; name one that a stage wrote or read")
    client = open_store(TrackingConfiguration(True, uri, None, None))
    end_killed_runs(client)
    experiments = {one.experiment_id: one.name for one in client.search_experiments()}
    lines = []
    for role, verb in (("output", "wrote"), ("input", "read")):
        tag = tag_name(role, shown_path(path))
        found = client.search_runs(list(experiments), f"tags.`{tag}` = '{digest}'")
        lines += [_line(verb, experiments[run.info.experiment_id], run) for run in found]
    return lines or [f"{path} ({digest}): no run wrote or read it"]


def _line(verb: str, experiment: str, run: Any) -> str:
    began = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(run.info.start_time / 1000))
    commit = run.data.tags.get("mlflow.source.git.commit", "no commit")[:12]
    return f"{verb:5}  {run.info.run_id}  {experiment}: {run.info.run_name}  {began}  {commit}  {run.info.status}"


if __name__ == "__main__":
    sys.exit(main())
