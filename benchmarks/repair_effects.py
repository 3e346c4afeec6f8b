"""What a repair gives back on the changed machine, effect by effect, beside a policy that is learned anew.

    python -m benchmarks.repair_effects --nominal LOGS --model MODEL --policy POLICY --output DIR
        [--cases delay:3 lag:3 …] [--seeds 0 1 2] [--targets 100] [--profile default]

LOGS, MODEL and POLICY are of the machine as it was: `make repro` writes data/raw/sessions, artifacts/identify/mlp_dqdot
and artifacts/apg/mlp_dqdot/seed_0. A case is a kind of effect and its size; the seed draws its joint and direction. Per
case: logs of the changed machine, `close_loop`, `repair`, `prove`. Anew: a model from as many logs of the changed
machine as LOGS has of the former one, APG on it, and `prove` with that policy in the repaired one's place.

    restored = (after - before) / (anew - before), of SR(0.04, 0.04)
    seconds: of a core, of `close_loop` and of `repair`; the first `close_loop` learns the nominal logs for all

A case whose policy loses little says nothing of a repair: its rate before tells. What stands in DIR is not done again.
Some twelve minutes of a core per case and seed.
"""

import argparse
import hashlib
import json
import resource
import shutil
import statistics
import subprocess
import sys
from pathlib import Path
from typing import Any

from pipeline.control.policy import META_FILE, POLICY_FILE
from pipeline.control.repair.files import DOCUMENT, NEW

CASES = ("delay:3", "lag:3", "stiction:3", "flow_coupling:1.5", "oscillation:3")
RICH_MINUTES, RICH_SEED = "[21.0,23.0,32.0]", 2  # as many as `record` has; other than the measured logs' seed


class Case:
    """One effect on one joint."""

    def __init__(self, given: argparse.Namespace, case: str, seed: int) -> None:
        kind, _, size = case.partition(":")
        self.name, self._given, self._seed = f"{kind} {size}, seed {seed}", given, seed
        self._folder = given.output / f"{kind}_{size}_{seed}"
        self._effect = [f"effects=[{kind}]", f"effects_seed={seed}", f"effect_size={size}"]

    def row(self) -> dict[str, Any]:
        """Rates before, after and anew; what was found in their place, where there was nothing to repair."""
        folder, given = self._folder, self._given
        measured, loop, repair = folder / "measured", folder / "loop", folder / "repair"
        self._stage("record_changed", measured, *self._effect)
        before = f"nominal={given.nominal}", f"measured={measured}/sessions", f"model={given.model}"
        self._stage("close_loop", loop, *before, f"learned={given.output}/learned", "page=false")
        after = loop / "model_after"
        if not (after / "effects.json").exists():
            return {"found": json.loads((loop / "closed_loop.json").read_text())["verdict"]}
        of_repair = f"policy={given.policy}", f"model={after}", f"seed={self._seed}"
        self._stage("repair", repair, *of_repair)
        document = self._prove(repair, after)
        found = document["on_machine"]
        anew = self._anew()
        return {
            "before": found["sr_before"],
            "after": found["sr_after"],
            "anew": anew["sr_after"],
            "oow": (found["oow_before"], found["oow_after"], anew["oow_after"]),
            "promotable": document["promotable"],
            "seconds": tuple(float((folder / f"{name}.done").read_text()) for name in ("loop", "repair")),
        }

    def _anew(self) -> dict[str, float]:
        """What the machine shows of a policy that was learned anew."""
        folder = self._folder
        rich, tuples, model, policy = (folder / name for name in ("rich", "tuples", "model", "anew"))
        minutes = f"record_changed.session_minutes={RICH_MINUTES}", f"record_changed.seed={RICH_SEED}"
        self._stage("record_changed", rich, *self._effect, *minutes)
        self._stage("ingest", tuples, f"logs={rich}/sessions", "page=false")
        self._stage("identify", model, f"tuples={tuples}")
        self._stage("apg", policy, f"model={model}", f"seed={self._seed}")
        rival = folder / "rival"
        put_in_place(folder / "repair", policy, rival)
        return dict(self._prove(rival, model)["on_machine"])

    def _prove(self, repair: Path, model: Path) -> dict[str, Any]:
        """What a repair's folder says after its policies drove the changed machine."""
        of_trials = f"repair={repair}", f"model={model}", f"targets={self._given.targets}"
        self._stage("prove", self._folder / f"trials_of_{repair.name}", *of_trials, *self._effect)
        return dict(json.loads((repair / DOCUMENT).read_text()))

    def _stage(self, stage: str, output: Path, *overrides: str) -> None:
        done = self._folder / f"{output.name}.done"
        if done.exists():
            return
        self._folder.mkdir(parents=True, exist_ok=True)
        command = [sys.executable, "-m", f"pipeline.stages.{stage}", f"output={output}", *overrides]
        since = _children_s()
        subprocess.run([*command, f"profile={self._given.profile}", "tracking=none"], check=True)
        done.write_text(str(_children_s() - since))


def put_in_place(repair: Path, policy: Path, rival: Path) -> None:
    """Copy a repair's folder, with another policy in the repaired one's place. One that stands stays."""
    if rival.exists():
        return
    partial = rival.with_suffix(".partial")
    shutil.rmtree(partial, ignore_errors=True)
    shutil.copytree(repair, partial)
    for name in (POLICY_FILE, META_FILE):
        shutil.copyfile(policy / name, partial / NEW / name)
    document = json.loads((partial / DOCUMENT).read_text())
    document["policies"][NEW] = hashlib.sha256((policy / POLICY_FILE).read_bytes()).hexdigest()
    (partial / DOCUMENT).write_text(json.dumps(document))
    partial.rename(rival)


def _children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def restored(row: dict[str, Any]) -> float:
    """Share of what the effect took that the repair gave back."""
    lost = row["anew"] - row["before"]
    return (row["after"] - row["before"]) / lost if lost > 0.0 else float("nan")


def main() -> None:
    """Run the cases, and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for name in ("nominal", "model", "policy", "output"):
        parser.add_argument(f"--{name}", type=Path, required=True)
    parser.add_argument("--cases", nargs="+", default=CASES)
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2])
    parser.add_argument("--targets", type=int, default=100)
    parser.add_argument("--profile", default="default")
    given = parser.parse_args()
    cases = [Case(given, case, seed) for case in given.cases for seed in given.seeds]
    rows = {case.name: case.row() for case in cases}
    print(
        "\n| effect | before | after | anew | OOW before | after | anew | restored | promotable | loop, repair [s] |"
    )
    print(f"{10 * '|---'}|")
    for name, row in rows.items():
        if "found" in row:
            print(f"| {name} | not found: {row['found']} |")
            continue
        rates = " | ".join(f"{row[key]:.2f}" for key in ("before", "after", "anew"))
        outside = " | ".join(f"{rate:.2f}" for rate in row["oow"])
        seconds = ", ".join(f"{each:.0f}" for each in row["seconds"])
        share = f"{restored(row):.0%}" if row["anew"] > row["before"] else "–"
        print(f"| {name} | {rates} | {outside} | {share} | {row['promotable']} | {seconds} |")
    shares = [restored(row) for row in rows.values() if "found" not in row and row["anew"] > row["before"]]
    if shares:
        print(f"\nrestored, median of {len(shares)}: {statistics.median(shares):.0%}")


if __name__ == "__main__":
    main()
