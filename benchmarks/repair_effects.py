"""What a repair gives back on the changed machine, effect by effect, beside a policy that is learned anew.

    python -m benchmarks.repair_effects --nominal LOGS --model MODEL --policy POLICY --output DIR
        [--cases delay:3 lag:3 …] [--seeds 0 1 2] [--targets 100] [--profile default]

LOGS, MODEL and POLICY are of the machine as it was: `make repro` writes data/raw/sessions, artifacts/identify/mlp_dqdot
and artifacts/apg/mlp_dqdot/seed_0. A case is a kind of effect and its size; the seed draws its joint and direction. Per
case: logs of the changed machine, `close_loop`, `repair`, `prove`. Anew: a model from plenty of logs of the changed
machine, APG on it, and the same targets.

    restored = (after - before) / (anew - before), of SR(0.04, 0.04)
    seconds: of a core, of `close_loop` and of `repair`; the first `close_loop` learns the nominal logs for all

A case whose policy loses little says nothing of a repair: its rate before tells. What stands in DIR is not done again.
Some ten minutes of a core per case and seed.
"""

import argparse
import json
import resource
import statistics
import subprocess
import sys
from pathlib import Path
from typing import Any

CASES = ("delay:3", "lag:3", "stiction:3", "flow_coupling:1.5", "oscillation:3")
RICH_MINUTES, RICH_SEED = 20.0, 2  # other than the measured logs' seed


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
        targets = f"targets={given.targets}"
        self._stage("prove", repair / "trials", f"repair={repair}", f"model={after}", targets, *self._effect)
        document = json.loads((repair / "repair.json").read_text())
        found = document["on_machine"]
        return {
            "before": found["sr_before"],
            "after": found["sr_after"],
            "anew": self._anew(),
            "oow": (found["oow_before"], found["oow_after"]),
            "promotable": document["promotable"],
            "seconds": tuple(float((folder / f"{name}.done").read_text()) for name in ("loop", "repair")),
        }

    def _anew(self) -> float:
        folder, given = self._folder, self._given
        rich, tuples, model, policy, drive = (
            folder / name for name in ("rich", "tuples", "model", "policy", "drive")
        )
        minutes = f"record_changed.session_minutes=[{RICH_MINUTES}]", f"record_changed.seed={RICH_SEED}"
        self._stage("record_changed", rich, *self._effect, *minutes)
        self._stage("ingest", tuples, f"logs={rich}/sessions", "page=false")
        self._stage("identify", model, f"tuples={tuples}")
        self._stage("apg", policy, f"model={model}", f"seed={self._seed}")
        of_policy = f"model={model}", f"policy={policy}", f"deployment.targets={given.targets}"
        self._stage("sim2real", drive, *of_policy, *self._effect)
        evaluation = folder / "drive.json"
        self._stage("evaluate_logs", evaluation, f"model={model}", f"logs={drive}/logs")
        return float(json.loads(evaluation.read_text())["reaching"]["sr_004_004"])

    def _stage(self, stage: str, output: Path, *overrides: str) -> None:
        done = self._folder / f"{output.name}.done"
        if done.exists():
            return
        self._folder.mkdir(parents=True, exist_ok=True)
        command = [sys.executable, "-m", f"pipeline.stages.{stage}", f"output={output}", *overrides]
        since = _children_s()
        subprocess.run([*command, f"profile={self._given.profile}", "tracking=none"], check=True)
        done.write_text(str(_children_s() - since))


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
        "\n| effect | before | after | anew | OOW before | after | restored | promotable | loop, repair [s] |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for name, row in rows.items():
        if "found" in row:
            print(f"| {name} | not found: {row['found']} |")
            continue
        rates = " | ".join(f"{row[key]:.2f}" for key in ("before", "after", "anew"))
        outside = " | ".join(f"{rate:.2f}" for rate in row["oow"])
        seconds = ", ".join(f"{each:.0f}" for each in row["seconds"])
        print(f"| {name} | {rates} | {outside} | {restored(row):.0%} | {row['promotable']} | {seconds} |")
    shares = [restored(row) for row in rows.values() if "found" not in row and row["anew"] > row["before"]]
    if shares:
        print(f"\nrestored, median of {len(shares)}: {statistics.median(shares):.0%}")


if __name__ == "__main__":
    main()
