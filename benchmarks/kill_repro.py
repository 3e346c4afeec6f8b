"""Kill test of the whole graph: `python -m benchmarks.kill_repro --kills 20`.

The graph runs on the smoke profile in two clones of the present commit. One is left alone. In the other, `dvc repro`
and all that it started is killed (SIGKILL to its process group) after random times, drawn by a seed, and started again,
until it has been killed as often as asked and has ended. Then must hold:

- every file that `dvc.lock` names as an output is there and has the hash that is stated there, and the metrics of both
  clones are equal;
- no run in MLflow is left running, and each kill shows as a run that was killed, if it hit one;
- the trials of a study that is killed along with it are all there once (`--trials`).

The answer is JSON on standard output; the exit status is 1 if something does not hold.
"""

import argparse
import json
import os
import random
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from pipeline.stages.processes.dvc_lock import mend
from pipeline.tracking.lineage import content_hash

ROOT = Path(__file__).resolve().parents[1]
SMALL = {
    "profile": "smoke",
    "seeds": "[0]",
    "icem_variants": "[icem]",
    "frames_per_second": "2",
}  # as `make graph-smoke`
NOT_DEPLOYED = re.compile(r"^  icem_double_dagger_.*\n", re.M)
# Run times differ from run to run by their nature.
NOT_COMPARED = re.compile(r"(^|[._])(seconds|step_time|wall)")
GIVE_UP_AFTER = 5  # runs in a row that fail without having been killed


def main() -> int:
    """Run both clones, compare, and print the answer."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--folder", type=Path, required=True, help="an empty folder for the two clones")
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--trials", type=int, default=4, help="of a search that is killed, too; 0: none")
    parser.add_argument(
        "--targets", nargs="*", default=[], help="nodes of the graph; the whole graph by default"
    )
    given = parser.parse_args()
    began_s = time.monotonic()
    clones = {name: clone(given.folder / name) for name in ("undisturbed", "killed")}
    commands = [["dvc", "repro", *given.targets]]
    if given.trials:
        commands.append(
            [sys.executable, "-m", "pipeline.stages.search", "profile=smoke", f"n_trials={given.trials}"]
        )
    alone_s = [run_to_the_end(clones["undisturbed"], command) for command in commands]
    draw, kills = random.Random(given.seed), []
    for command, duration_s in zip(commands, alone_s, strict=True):
        share = given.kills if len(commands) == 1 else round(given.kills * duration_s / sum(alone_s))
        kills += kill_and_start_again(clones["killed"], command, max(share, 1), duration_s, draw)
    findings = (
        corrupt_outputs(clones["killed"])
        + different_metrics(clones["undisturbed"], clones["killed"])
        + (different_trials(clones["undisturbed"], clones["killed"], given.trials) if given.trials else [])
    )
    statuses = run_statuses(clones["killed"])
    findings += [f"{statuses['RUNNING']} runs in MLflow are left running"] if statuses.get("RUNNING") else []
    answer = {
        "kills": len(kills),
        "killed_within": kills,
        "undisturbed_s": [round(one, 1) for one in alone_s],
        "mlflow_statuses": statuses,
        "findings": findings,
        "duration_s": round(time.monotonic() - began_s, 1),
    }
    print(json.dumps(answer, indent=1))
    return 1 if findings else 0


def clone(folder: Path) -> Path:
    """A clone of the present commit that runs the smoke profile; outputs under git are taken away."""
    subprocess.run(["git", "clone", "--quiet", str(ROOT), str(folder)], check=True)
    text = (folder / "params.yaml").read_text()
    for key, value in SMALL.items():
        text = re.sub(rf"^{key}: .*", f"{key}: {value}", text, flags=re.M)
    (folder / "params.yaml").write_text(NOT_DEPLOYED.sub("", text))
    (folder / "dvc.lock").unlink(missing_ok=True)
    return folder


def start(folder: Path, command: list[str]) -> subprocess.Popen[bytes]:
    """Start a command in a clone, with a process group of its own, in this interpreter's environment."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {
        key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "MLFLOW_TRACKING_URI")
    }
    with (folder.parent / f"{folder.name}.log").open("ab") as log:
        return subprocess.Popen(
            command,
            cwd=folder,
            env=environment | {"PATH": path},
            stdout=log,
            stderr=log,
            start_new_session=True,
        )


def run_to_the_end(folder: Path, command: list[str]) -> float:
    """Run a command undisturbed; gives its duration in s."""
    began_s = time.monotonic()
    if start(folder, command).wait() != 0:
        sys.exit(f"error: {' '.join(command)} failed undisturbed; see {folder}.log")
    return time.monotonic() - began_s


def kill_and_start_again(
    folder: Path, command: list[str], n_kills: int, duration_s: float, draw: random.Random
) -> list[str]:
    """Kill the command so many times, then let it end. Gives what each kill hit.

    A kill comes after a time drawn up to twice a kill's even share of the whole duration, so that they are spread over
    the graph. A command that ends before it was killed often enough is made to do its last third again.
    """
    hit: list[str] = []
    failures = 0
    while True:
        mend(folder)  # as `make repro` does
        process = start(folder, command)
        wait_s = draw.uniform(0.0, 2.0 * max(duration_s / (n_kills + 1), STARTING_S))
        try:
            status = process.wait(timeout=wait_s if len(hit) < n_kills else None)
        except subprocess.TimeoutExpired:
            hit.append(running_stage(process.pid))
            kill_group(process)
            continue
        if status != 0:
            failures += 1
            if failures >= GIVE_UP_AFTER:
                sys.exit(f"error: {' '.join(command)} does not get up again; see {folder}.log")
            continue
        if len(hit) >= n_kills or command[0] != "dvc":
            return hit
        forget_last_stages(folder)


STARTING_S = 20.0  # before a stage is at work: interpreter, imports, DVC's look at the graph


def running_stage(pid: int) -> str:
    """Name of the stage that runs in a session, for the answer."""
    listed = subprocess.run(
        ["ps", "-s", str(pid), "-o", "args="], capture_output=True, text=True, check=False
    )
    stages = re.findall(r"pipeline\.stages\.(\w+)", listed.stdout)
    return stages[0] if stages else "between stages"


def kill_group(process: subprocess.Popen[bytes]) -> None:
    """SIGKILL the command and everything that it started (all of its session)."""
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    left = subprocess.run(["pkill", "-KILL", "-s", str(process.pid)], check=False)
    if left.returncode == 0:
        time.sleep(1.0)


def forget_last_stages(folder: Path) -> None:
    """Make DVC do the last third of its stages again, so that there is something to kill."""
    lock = folder / "dvc.lock"
    content = yaml.safe_load(lock.read_text())
    names = list(content["stages"])
    for name in names[-max(len(names) // 3, 1) :]:
        del content["stages"][name]
    lock.write_text(yaml.safe_dump(content, sort_keys=False))


def corrupt_outputs(folder: Path) -> list[str]:
    """Outputs that are missing, or are not what `dvc.lock` says."""
    stages = yaml.safe_load((folder / "dvc.lock").read_text())["stages"]
    return [
        f"{out['path']} of {name} is not what dvc.lock says"
        for name, stage in stages.items()
        for out in stage.get("outs", [])
        if content_hash(folder / out["path"]) != out["md5"]
    ]


def different_metrics(undisturbed: Path, killed: Path) -> list[str]:
    """Metrics and tables of numbers that differ between two clones."""

    def values(folder: Path) -> dict[str, Any]:
        shown = subprocess.run(
            [str(Path(sys.executable).with_name("dvc")), "metrics", "show", "--json"],
            cwd=folder, capture_output=True, text=True, check=True,
        )  # fmt: skip
        files = json.loads(shown.stdout).get("", {}).get("data", {})
        return dict(
            leaf for name, file in files.items() for leaf in leaves(name, file.get("data", "missing"))
        )

    first, second = values(undisturbed), values(killed)
    return [
        f"{key}: {first.get(key)} undisturbed, {second.get(key)} killed"
        for key in sorted(first.keys() | second.keys())
        if first.get(key) != second.get(key) and not NOT_COMPARED.search(key)
    ]


def leaves(name: str, tree: Any) -> list[tuple[str, Any]]:
    """The leaves of a tree with their paths."""
    if isinstance(tree, dict):
        return [leaf for key, branch in tree.items() for leaf in leaves(f"{name}.{key}", branch)]
    return [(name, tree)]


def different_trials(undisturbed: Path, killed: Path, n_trials: int) -> list[str]:
    """Trials that were lost, doubled, or came to another result."""
    without_times: Callable[[dict[str, str]], dict[str, str]] = lambda row: {  # noqa: E731
        key: cell for key, cell in row.items() if key not in ("seconds", "attempts")
    }
    tables = []
    for folder in (undisturbed, killed):
        header, *rows = (folder / "artifacts/search/mlp_dqdot/trials.csv").read_text().splitlines()
        tables.append(
            [without_times(dict(zip(header.split(","), row.split(","), strict=False))) for row in rows]
        )
    findings = [] if len(tables[1]) == n_trials else [f"{len(tables[1])} trials instead of {n_trials}"]
    return findings + ([] if tables[0] == tables[1] else ["the trials came to other results"])


def run_statuses(folder: Path) -> dict[str, int]:
    """How many runs in a clone's tracking store have each status."""
    from mlflow import MlflowClient

    client = MlflowClient(f"sqlite:///{folder}/mlflow.db")
    counts: dict[str, int] = {}
    for experiment in client.search_experiments():
        for run in client.search_runs([experiment.experiment_id]):
            counts[run.info.status] = counts.get(run.info.status, 0) + 1
    return counts


if __name__ == "__main__":
    sys.exit(main())
