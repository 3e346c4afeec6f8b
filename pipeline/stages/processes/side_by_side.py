"""DVC's graph with independent stages side by side: `python -m pipeline.stages.processes.side_by_side [FILE [STAGE…]]`.

`dvc repro` runs one stage at a time, and most stages keep one core busy. Here each stage is a process of DVC for
itself, and starts as soon as those above it are done. DVC's own locks keep `dvc.lock` whole.
"""

import json
import re
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from functools import cache
from graphlib import TopologicalSorter

AT_ONCE = 2  # cores of the computer that the profiles are for
ROOT = "dvc.yaml"

Above = Mapping[str, Iterable[str]]


def read_graph(dot: str, file: str = ROOT) -> dict[str, set[str]]:
    """Stages of one file in its order, each with those of the same file that it needs, from `dvc dag --dot`."""
    prefix = "" if file == ROOT else f"{file}:"

    def names(line: str) -> list[str]:
        found = re.findall(r'"([^"]+)"', line)
        return [name for name in found if name.startswith(prefix) and (":" in name) == bool(prefix)]

    lines = [line for line in dot.splitlines() if '"' in line]
    above: dict[str, set[str]] = {name: set() for line in lines if "->" not in line for name in names(line)}
    for line in lines:
        if "->" in line and len(edge := names(line)) == 2:
            above[edge[1]].add(edge[0])
    return above


def leading_to(above: Above, ends: Iterable[str]) -> Above:
    """The part of the graph that stages need, each named as `stage@cell`, or as `stage` with all its cells."""
    needed: set[str] = set()
    left = [name for name in above if {name, name.partition("@")[0]}.intersection(ends)]
    while left:
        if (name := left.pop()) not in needed:
            needed.add(name)
            left += above[name]
    return {name: above[name] for name in needed}


def to_run(above: Above, changed: Iterable[str]) -> dict[str, set[str]]:
    """The part of the graph that changed stages may reach."""
    reached = set(changed)
    for name in TopologicalSorter(above).static_order():
        if reached.intersection(above[name]):
            reached.add(name)
    return {name: reached.intersection(needed) for name, needed in above.items() if name in reached}


def run_all(above: Above, run: Callable[[str], int], at_once: int = AT_ONCE) -> int:
    """Run every stage, at most `at_once` side by side; of those that can start, that with the longest chain below.

    Returns:
        0, or the status of the first stage that failed: those that run then end, no other one starts.
    """

    @cache
    def in_a_row_below(name: str) -> int:
        return max(
            (1 + in_a_row_below(other) for other, needed in above.items() if name in needed), default=0
        )

    sorter = TopologicalSorter(above)
    sorter.prepare()
    ready: list[str] = []
    running: dict[Future[int], str] = {}
    with ThreadPoolExecutor(at_once) as pool:
        while sorter.is_active():
            ready = sorted([*ready, *sorter.get_ready()], key=in_a_row_below, reverse=True)
            while ready and len(running) < at_once:
                name = ready.pop(0)
                running[pool.submit(run, name)] = name
            for finished in wait(running, return_when=FIRST_COMPLETED).done:
                if status := finished.result():
                    return status
                sorter.done(running.pop(finished))
    return 0


def repro(name: str) -> int:
    """Run one stage by DVC, and print its lines with the stage's name."""
    command = ["dvc", "--wait-for-lock", "repro", "--single-item", name]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if line.strip() and not line.startswith(("Use `dvc push`", "Updating lock file", "To track")):
                with _PRINTING:
                    print(f"{name}: {line.rstrip()}", flush=True)
    return process.returncode


def main(file: str = ROOT, *ends: str) -> int:
    """Run what has changed of one file's graph: all of it, or what some of its stages need."""
    above: Above = read_graph(_dvc("dag", "--dot"), file)
    if ends:
        above = leading_to(above, ends)
    changed = json.loads(_dvc("status", "--json", file))
    return run_all(to_run(above, set(changed).intersection(above)), repro)


def _dvc(*arguments: str) -> str:
    return subprocess.run(["dvc", *arguments], stdout=subprocess.PIPE, text=True, check=True).stdout


_PRINTING = threading.Lock()

if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
