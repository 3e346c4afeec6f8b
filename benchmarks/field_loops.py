"""What `close_loop` says of the simulated machine in the field: without a change, and with one drawn by lot.

    python -m benchmarks.field_loops ROOT [--unchanged 40] [--changed 12] [--minutes 60]

Three draws of the machine, `ROOT/0` to `ROOT/2`: nominal logs and the model of them, made where they are not there.
Recordings take the draws in turn. Kinds, joints and sizes of changes are drawn as the blind benchmark draws them. Each
answer is a line of `ROOT/ledger.jsonl`, so that a further call goes on; it ends after so many minutes of processor
time. Some 70 s of a core per recording.
"""

import argparse
import json
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.closed_loop.draw import SMALLEST_SHARE
from benchmarks.closed_loop.hydraulic_plant import LARGEST_SIZE
from benchmarks.closed_loop.intervals import clopper_pearson
from pipeline.configuration.load import ControlConfiguration, load_machine, load_section
from pipeline.discrepancy.from_logs import LoopInputs, close_loop_on_logs
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.logs.ingest_config import IngestConfig
from pipeline.plant.machines.simulated import Condition
from pipeline.plant.recording.session import RecordConfig
from pipeline.plant.sealed.unseal import unseal
from pipeline.testbench import recording
from pipeline.tracking import progress_bar

MACHINE, PROFILE = load_machine("bobcat_e10"), "default"
N_WINDOWS = (8320, 8161, 8078)  # on which models are chosen: all validation windows of each draw
FIRST_SEED = 100  # of `record_changed`
WITHOUT, WITH = "without", "with"


def learn(draw: Path) -> None:
    """Nominal logs of a draw of the machine, and the model that is identified from them."""
    for stage, output, overrides in (
        ("record", "nominal", ["condition=field", f"record.seed={draw.name}"]),
        ("ingest", "tuples", [f"logs={draw}/nominal/sessions", "page=false"]),
        (
            "identify",
            "model",
            [f"tuples={draw}/tuples", f"identify.evaluation_windows={N_WINDOWS[int(draw.name)]}"],
        ),
    ):
        if not (draw / output).exists():
            command = [
                sys.executable,
                "-m",
                f"pipeline.stages.{stage}",
                f"output={draw / output}",
                *overrides,
            ]
            subprocess.run([*command, f"profile={PROFILE}", "tracking=none"], check=True)


def change_of(number: int) -> tuple[list[str], float]:
    """Kind and size of a change."""
    random = np.random.default_rng([FIRST_SEED, number])
    kind = str(random.choice(list(LARGEST_SIZE)))
    return [kind], LARGEST_SIZE[kind] * SMALLEST_SHARE ** random.random()


def judge(root: Path, which: str, number: int) -> dict[str, Any]:
    """Record the machine with or without a change, close the loop, and open the seal."""
    draw, folder = root / str(number % len(N_WINDOWS)), root / which / str(number)
    record = replace(load_section("record", RecordConfig, PROFILE), seed=int(draw.name))
    changed = load_section("record_changed", recording.RecordChangedConfig, PROFILE)
    changed = replace(changed, seed=FIRST_SEED + number)
    kinds, size = change_of(number) if which == WITH else ([], 1.0)
    lot = recording.EffectDraw(kinds, number, size, changed.session_minutes[0], Condition.field)
    effects = recording.begin_recording(folder, [recording.SESSIONS], "record_changed", {}, MACHINE, lot)
    sessions = recording.changed_sessions(folder, record, changed)
    recording.record_sessions(folder, sessions, MACHINE, effects, Condition.field, progress_bar)
    close_loop_on_logs(
        LoopInputs(
            nominal=f"{draw}/nominal/sessions",
            measured=f"{folder}/sessions",
            model=f"{draw}/model",
            kind="nfir_dqdot",
            learned=f"{draw}/learned",
        ),
        folder / "loop",
        MACHINE,
        load_section("ingest", IngestConfig, PROFILE),
        load_section("control", ControlConfiguration, PROFILE).loop_tracker,
        load_section("identify", IdentifyConfig, PROFILE),
        load_section("close_loop", CloseLoopConfig, PROFILE),
        print,
    )
    told = json.loads((folder / "loop/closed_loop.json").read_text())
    judgement = unseal(folder / "loop/closed_loop.json", folder / recording.SEAL, None)
    found = {key: told[key] for key in ("verdict", "detected", "effects", "alternatives", "trace", "error")}
    return {"which": which, "number": number, "kinds": kinds, "size": size, **judgement, **found}


def share(n: int, of: int) -> str:
    """A count with the 95 % interval of Clopper and Pearson."""
    low, high = clopper_pearson(n, of)
    return f"{n} of {of} ({low:.0%} to {high:.0%})"


def summary(ledger: Sequence[dict[str, Any]]) -> str:
    """Tables: how many recordings are told to have changed, as what; and each change beside the answer."""
    unchanged = [entry for entry in ledger if entry["which"] == WITHOUT]
    changed = [entry for entry in ledger if entry["which"] == WITH]
    lines = []
    if unchanged:
        alarms = [entry for entry in unchanged if entry["detected"]]
        certain = sum(all(effect["certain"] for effect in entry["effects"]) for entry in alarms)
        named = Counter(said.partition(" ")[0] for entry in alarms for said in entry["said"])
        told = ", ".join(f"{family} {n}" for family, n in named.most_common())
        lines.append(f"false alarms: {share(len(alarms), len(unchanged))}, {certain} with certainty: {told}")
    if changed:
        detected = [entry for entry in changed if entry["detected"]]
        right = sum(entry["family_right"] for entry in detected)
        lines.append(f"detected: {share(len(detected), len(changed))}, right family {right}")
        lines += ["", "| change | size of largest | told |", "|---|---|---|"]
        for entry in changed:
            of_largest = entry["size"] / LARGEST_SIZE[entry["kinds"][0]]
            told = "; ".join(entry["said"]) or "–"
            lines.append(f"| {'; '.join(entry['truth'])} | {of_largest:.0%} | {told} |")
    return "\n".join(lines)


def main() -> None:
    """Go on with the ledger, and print what it holds."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("root", type=Path)
    parser.add_argument("--unchanged", type=int, default=40)
    parser.add_argument("--changed", type=int, default=12)
    parser.add_argument("--minutes", type=float, default=60.0, help="of processor time")
    options = parser.parse_args()
    for draw in range(len(N_WINDOWS)):
        learn(options.root / str(draw))
    path = options.root / "ledger.jsonl"
    read = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    done = {(entry["which"], entry["number"]) for entry in read}
    asked = [(WITHOUT, n) for n in range(options.unchanged)] + [(WITH, n) for n in range(options.changed)]
    for case in asked:
        if case not in done and time.process_time() < 60.0 * options.minutes:
            entry = judge(options.root, *case)
            with path.open("a") as ledger:
                ledger.write(json.dumps(entry) + "\n")
            read.append(entry)
    print(summary(read))


if __name__ == "__main__":
    main()
