"""What a fresh reader expects of a repository: it says what it is, whose it is, how it is checked."""

import re
import subprocess
import tomllib
from collections import Counter
from pathlib import Path

import pytest
import yaml
from pre_commit.clientlib import load_config

ROOT = Path(__file__).parents[1]
MOST_ENTRIES = 15  # in a folder of unlike files: as many as a reader takes in at once
# Lists of alike files, of which a reader knows the name: layers, commands, effects, rules of one family each.
ALIKE = {
    "pipeline",
    "pipeline/stages",
    "pipeline/effects",
    "pipeline/plant/effects",
    "pipeline/discrepancy/families",
}
MOST_STAGE_LINES = 60
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


def test_hooks_are_tools_of_the_locked_environment() -> None:
    locked = set(re.findall(r"^([a-z0-9-]+)==", (ROOT / "requirements.lock").read_text(), re.M))
    hooks = load_config(str(ROOT / ".pre-commit-config.yaml"))["repos"]
    assert [repository["repo"] for repository in hooks] == ["local"]  # nothing is downloaded
    programs = {Path(hook["entry"].split()[0]) for repository in hooks for hook in repository["hooks"]}
    assert {program.parent for program in programs} == {Path(".venv/bin")}
    assert {program.name.replace("lint-imports", "import-linter") for program in programs} <= locked


@pytest.mark.parametrize("target", ["check", "test-all"])  # before a commit, and in `.ci/run`
def test_make_checks_what_the_hooks_check(target: str) -> None:
    command = ["make", "--dry-run", "--always-make", target]
    recipe = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for repository in load_config(str(ROOT / ".pre-commit-config.yaml"))["repos"]:
        for hook in repository["hooks"]:
            assert hook["entry"].removesuffix(" --force-exclude") in recipe


def test_packages_for_a_machine_with_its_own_jax_are_locked() -> None:
    makefile = (ROOT / "Makefile").read_text().replace("\\\n", "")
    packages = re.findall(r"^GPU_PACKAGES := (.*)$", makefile, re.M)[0].split()
    locked = re.findall(r"^([a-z0-9-]+)==", (ROOT / "requirements.lock").read_text(), re.M)
    assert packages and set(packages) <= set(locked)


def test_make_help_names_every_target() -> None:
    shown = subprocess.run(["make"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    targets = re.findall(r"^\.PHONY: (\S+)", (ROOT / "Makefile").read_text(), re.M)
    assert targets and all(re.search(rf"^  make {target} ", shown, re.M) for target in targets)


def test_citation_names_paper_and_software() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["cff-version"] == "1.2.0" and citation["version"] == PROJECT["project"]["version"]
    (paper,) = citation["references"]
    assert paper["title"] in " ".join((ROOT / "README.md").read_text().split()).replace("*", "")
    assert [author["family-names"] for author in paper["authors"]] == [
        "Leiva", "Canales", "Valenzuela", "Ruiz-del-Solar",
    ]  # fmt: skip


def test_licence_and_changelog_are_of_this_version() -> None:
    project = PROJECT["project"]
    assert (ROOT / "LICENSE").read_text().startswith(f"{project['license']} License")
    assert f"\n## {project['version']}" in (ROOT / "CHANGELOG.md").read_text()


def test_a_wheel_has_every_file_of_the_library() -> None:
    listed = subprocess.run(
        ["git", "ls-files", "pipeline"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    others = {Path(name) for name in listed.stdout.splitlines() if not name.endswith(".py")}
    packed = {
        path.relative_to(ROOT)
        for package, patterns in PROJECT["tool"]["setuptools"]["package-data"].items()
        for pattern in patterns
        for path in (ROOT / package.replace(".", "/")).glob(pattern)
    }
    assert others and others <= packed


def library_files() -> list[Path]:
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "pipeline"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return [path for path in map(Path, listed.splitlines()) if (ROOT / path).exists()]


def test_a_folder_of_unlike_files_is_seen_at_a_glance() -> None:
    files = [path for path in library_files() if path.name != "__init__.py"]
    entries = {entry for path in files for entry in (path, *path.parents[:-2])}
    counts = Counter(str(entry.parent) for entry in entries)
    assert {name: n for name, n in counts.items() if n > MOST_ENTRIES and name not in ALIKE} == {}


def test_no_module_lies_loose_beside_the_layers() -> None:
    assert [path.name for path in library_files() if path.parent == Path("pipeline")] == [
        "__init__.py",
        "errors.py",
    ]


def test_stages_are_thin() -> None:
    lines = {
        path.name: len((ROOT / path).read_text().splitlines())
        for path in library_files()
        if path.parent == Path("pipeline/stages")
    }
    assert lines and {name: n for name, n in lines.items() if n > MOST_STAGE_LINES} == {}
