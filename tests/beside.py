"""The tests beside what changed since a commit: `python -m tests.beside origin/main`.

A changed test file runs itself. A changed module runs the test files of its name in its own place under `tests`, then
those that import it. A helper or `conftest.py` of the tests runs what imports it, or lies in its folder.
`conf/<stage>.yaml` runs the stage's tests, `dvc.yaml` those of the graph.
Long and slow tests are left out. After `BUDGET_S` the run ends, and says how many tests it did not reach.
"""

import re
import subprocess
import sys
import time
from collections.abc import Iterable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
BUDGET_S = 30.0
CLOSEST, NAMESAKE, IMPORTS, FOLDER = range(4)
PAGES = ("tests/test_docs.py", "tests/test_prose.py", "tests/test_house.py")


def changed_since(commit: str) -> list[str]:
    """Paths that differ from the common ancestor with `commit`, in commits or in the working tree, new files included.

    Raises:
        SystemExit: Git does not know the commit.
    """

    def git(*words: str) -> list[str]:
        done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=False)
        if done.returncode:
            sys.exit(f"error: check: SINCE={commit}: {done.stderr.strip().splitlines()[0]}")
        return done.stdout.splitlines()

    (ancestor,) = git("merge-base", commit, "HEAD")
    return git("diff", "--name-only", ancestor) + git("ls-files", "--others", "--exclude-standard")


def files_beside(changed: Iterable[str], sources: dict[str, str]) -> list[str]:
    """Test files for the changed paths, closest first.

    Args:
        changed: Paths from the repository's root.
        sources: The text of every Python file under `tests`, by its path.
    """
    distance: dict[str, int] = {}
    for path in changed:
        for test in (name for name in sources if Path(name).name.startswith("test_")):
            found = _distance(path, test, sources[test])
            if found is not None:
                distance[test] = min(found, distance.get(test, found))
    return sorted(distance, key=lambda test: (distance[test], test))


def _distance(path: str, test: str, source: str) -> int | None:
    if path == test:
        return CLOSEST
    changed = Path(path)
    if changed.suffix != ".py":
        if test == _test_of_setting(changed):
            return NAMESAKE
        return IMPORTS if test in PAGES else None
    package, *folders = changed.parts[:-1] or ("",)
    if package == "pipeline" and Path(test).name == f"test_{changed.name}":
        return NAMESAKE if Path(test).parts[1 : 1 + len(folders[:1])] == tuple(folders[:1]) else IMPORTS
    if _imports(path, source):
        return IMPORTS
    if changed.name == "conftest.py" and changed.parent in Path(test).parents:
        return FOLDER
    return None


def _test_of_setting(changed: Path) -> str | None:
    """The test file of a stage's configuration, `conf/<stage>.yaml`, or of a `dvc.yaml`."""
    if changed.name == "dvc.yaml":
        return "tests/stages/test_dvc_graph.py"
    return f"tests/stages/test_{changed.stem}.py" if changed.match("conf/*.yaml") else None


def _imports(path: str, source: str) -> bool:
    """Whether the source imports the module at the path by its absolute name, in any of the three forms."""
    module = ".".join(Path(path).with_suffix("").parts).removesuffix(".__init__")
    package, _, name = module.rpartition(".")
    return bool(
        re.search(rf"^\s*(?:from|import) {re.escape(module)}\b(?!\.)", source, re.M)
        or (
            package
            and re.search(rf"^\s*from {re.escape(package)} import [^#\n]*\b{re.escape(name)}\b", source, re.M)
        )
    )


class Budget:
    """Ends the run when its time is over."""

    def __init__(self) -> None:
        self.left, self.is_over, self._end_s = 0, False, time.monotonic() + BUDGET_S

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        self.left = len(session.items)

    def pytest_runtest_logfinish(self) -> None:
        self.left -= 1

    def pytest_runtest_protocol(self, item: pytest.Item) -> None:
        if time.monotonic() > self._end_s:
            self.is_over = True
            item.session.shouldstop = f"{BUDGET_S:.0f} s are over"


def main(commit: str) -> int:
    """Run them; the exit status is pytest's, and 0 without any test to run."""
    sources = {str(path.relative_to(ROOT)): path.read_text() for path in (ROOT / "tests").rglob("*.py")}
    files = files_beside(changed_since(commit), sources)
    if not files:
        print(f"no tests beside what changed since {commit}")
        return 0
    budget = Budget()
    status = int(pytest.main(["-x", "-m", "not long and not slow", *files], [budget]))
    if budget.is_over and status == pytest.ExitCode.INTERRUPTED:
        print(f"{budget.left} tests were not reached within {BUDGET_S:.0f} s; `make test` runs them")
        return 0
    return 0 if status == pytest.ExitCode.NO_TESTS_COLLECTED else status


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
