"""What the pages tell a reader to type is valid, and what they link to is there.

Bash itself takes the pages' commands apart (comments, quotes, continuations, loops). It has no programs to run:
every command that it would start is written down instead, and is then checked by what would read it.
"""

import argparse
import importlib
import re
import shlex
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest
import yaml
from dvc.cli import parse_args
from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from omegaconf import OmegaConf, open_dict

from hydra_plugins.checked_sweeper import CheckedSweeper
from pipeline.configuration.stage import check
from pipeline.errors import InputError
from pipeline.stages.processes.demo_steps import STEPS

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md"))]
# In the pages these stand for a machine of the reader's own.
OWN_MACHINES = {"machine=mine", "machine=NAME"}
NO_COMMAND = re.compile(r"<|…|\.\.\.|\[overrides\]")  # in running text: a pattern of commands
REFUSED = re.compile(r"error:")  # an answer that a page shows for a mistake

# Bash finds no program and asks this for each command instead; fields end with NUL, commands with another one.
WRITE_DOWN = r"""
command_not_found_handle() { printf '%s\0' "$@"; printf '\0'; }
source() { :; }
cd() { :; }
"""


@dataclass(frozen=True)
class Command:
    """A command as a page shows it, and whether the answer that is shown refuses it."""

    page: str
    words: tuple[str, ...]
    refused: bool = False

    def __str__(self) -> str:
        return f"{self.page}: {' '.join(self.words)}"


def taken_apart(script: str, page: str) -> list[tuple[str, ...]]:
    """The commands that bash would run, with their words."""
    environment = {"PATH": "/none", "EDITOR": "editor"}
    bash = ["/bin/bash", "--restricted", "-c", WRITE_DOWN + script]
    result = subprocess.run(bash, capture_output=True, text=True, env=environment, cwd="/", check=False)
    assert result.returncode == 0 and not result.stderr, f"{page}: {result.stderr}\n{script}"
    return [tuple(fields.split("\0")) for fields in result.stdout.split("\0\0") if fields]


def commands_of(path: Path) -> Iterator[Command]:
    text, page = path.read_text(encoding="utf-8"), path.name
    for language, block in re.findall(r"^```(bash|console)\n(.*?)^```", text, re.DOTALL | re.MULTILINE):
        if language == "bash":
            yield from (Command(page, words) for words in taken_apart(block, page))
            continue
        for session in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]:
            typed, _, answer = session.partition("\n")
            yield from (
                Command(page, words, bool(REFUSED.match(answer))) for words in taken_apart(typed, page)
            )
    prose = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    for inline in re.findall(r"`([^`]+)`", prose):
        typed = " ".join(inline.split())
        if re.match(r"(python|make|dvc) ", typed) and not NO_COMMAND.search(typed):
            yield from (Command(page, words) for words in taken_apart(typed, page))


COMMANDS = list(dict.fromkeys(command for path in PAGES for command in commands_of(path)))


def starting(*words: str) -> list[Command]:
    return [command for command in COMMANDS if command.words[: len(words)] == words]


STAGE = r"pipeline\.stages\.(?!processes\.)"
STAGE_COMMANDS = [c for c in starting("python", "-m") if re.match(STAGE, c.words[2])]
DEMO_COMMANDS = [
    Command("make demo", ("python", "-m", *shlex.split(f"pipeline.stages.{command}"))) for _, command in STEPS
]
PROGRAM_COMMANDS = [
    c
    for c in starting("python")
    if re.match(
        rf"(benchmarks|tests)[./]|(?!{STAGE})pipeline\.", c.words[2] if c.words[1] == "-m" else c.words[1]
    )
]


def jobs(overrides: list[str]) -> list[list[str]]:
    """The overrides of each job; a sweep has several."""
    if "-m" not in overrides:
        return [overrides]
    swept = OverridesParser.create().parse_overrides([word for word in overrides if word != "-m"])
    (batch,) = CheckedSweeper.split_arguments(swept, max_batch_size=None)
    return batch


@pytest.mark.parametrize("command", [*STAGE_COMMANDS, *DEMO_COMMANDS], ids=str)
def test_stages_take_the_pages_overrides(command: Command) -> None:
    """Composed and checked as the stage itself does it; nothing may be missing."""
    stage = command.words[2].removeprefix("pipeline.stages.")
    importlib.import_module(command.words[2])
    written = [word.strip("[]") if re.fullmatch(r"\[\w+=\S+\]", word) else word for word in command.words[3:]]
    overrides = ["machine=bobcat_e10" if word in OWN_MACHINES else word for word in written]
    messages = []
    GlobalHydra.instance().clear()
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        try:
            for job in jobs(overrides):
                composed = compose(stage, overrides=job, return_hydra_config=True)
                HydraConfig.instance().set_config(composed)
                with open_dict(composed):
                    del composed["hydra"]
                check(composed)
                OmegaConf.resolve(composed)
        except (HydraException, InputError) as error:
            messages.append(str(error))
        finally:
            HydraConfig.instance().cfg = None
    assert bool(messages) is command.refused, messages


def makefile() -> str:
    return (ROOT / "Makefile").read_text(encoding="utf-8")


@pytest.mark.parametrize("command", starting("make"), ids=str)
def test_make_has_the_pages_targets_and_variables(command: Command) -> None:
    for word in command.words[1:]:
        name, given, _ = word.partition("=")
        assert f"$({name})" in makefile() if given else f"\n.PHONY: {name}\n" in makefile()


@cache
def nodes() -> set[str]:
    """Addresses of DVC's nodes, from the graph itself."""
    from dvc.repo import Repo

    with Repo(str(ROOT)) as repository:
        return {stage.addressing for stage in repository.index.stages}


@pytest.mark.parametrize("command", starting("dvc"), ids=str)
def test_dvc_takes_the_pages_commands(command: Command) -> None:
    """DVC's own parser reads the command; nodes and parameters that it names exist."""
    arguments = parse_args(["1" if word == "N" else word for word in command.words[1:]])
    for target in getattr(arguments, "targets", None) or []:
        assert target in nodes() or (ROOT / target).exists()
    for setting in getattr(arguments, "set_param", None) or []:
        place, _, _ = setting.partition("=")
        file, key = place.split(":") if ":" in place else ("params.yaml", place)
        content = yaml.safe_load((ROOT / file).read_text(encoding="utf-8"))
        sections = key.split(".")
        below = content.get(sections[0])
        assert below is not None, f"{file} has no {sections[0]}"
        if len(sections) > 1:  # a profile may state it, or take it from the paper's
            paper = yaml.safe_load((ROOT / "conf/profile/paper.yaml").read_text(encoding="utf-8"))
            assert sections[1] in below or sections[1] in paper[sections[0]]


class Parsed(Exception):
    """The arguments were understood; nothing more should happen."""


@pytest.mark.parametrize("command", PROGRAM_COMMANDS, ids=str)
def test_other_programs_take_the_pages_arguments(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    if command.words[1] == "-m":
        name, arguments = command.words[2], command.words[3:]
    else:
        name, arguments = command.words[1].removesuffix(".py").replace("/", "."), command.words[2:]
        monkeypatch.syspath_prepend(ROOT / Path(command.words[1]).parent)  # as Python does for a script
    path = ROOT / name.replace(".", "/")
    path = path / "__main__.py" if path.is_dir() else path.with_suffix(".py")
    assert path.exists()
    if "ArgumentParser(" not in path.read_text(encoding="utf-8"):
        return  # it takes words by their place; that it is there must do
    parsers = {how: getattr(argparse.ArgumentParser, how) for how in ("parse_args", "parse_known_args")}

    def parse_only(how: str) -> Callable[..., None]:
        def parse(parser: argparse.ArgumentParser, *_: object, **__: object) -> None:
            monkeypatch.undo()  # the one is made of the other
            parsers[how](parser, list(arguments))
            raise Parsed

        return parse

    for how in parsers:  # the latter by programs that hand on what they do not know
        monkeypatch.setattr(argparse.ArgumentParser, how, parse_only(how))
    with pytest.raises(Parsed):
        importlib.import_module(f"{name}.__main__" if path.stem == "__main__" else name).main()


def test_pages_have_commands_of_every_kind() -> None:
    """Or the tests above have nothing to check."""
    assert STAGE_COMMANDS and PROGRAM_COMMANDS and starting("make") and starting("dvc")
    assert any(command.refused for command in STAGE_COMMANDS)
    unknown = {command.words[0] for command in COMMANDS} - {"python", "make", "dvc"}
    assert unknown <= {"cp", "editor", "git", "mkdir", "rerun", "roslaunch"}  # other programs' own affair


def test_commands_stay_within_the_repository() -> None:
    """A fresh clone has nothing beside it."""
    outside = re.compile(r"(^|[=\[,/'\"])\.\.(/|$)")
    assert not [str(command) for command in COMMANDS if any(outside.search(word) for word in command.words)]


def anchor(heading: str) -> str:
    """A heading's address, as GitHub and MkDocs both make it."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.name)
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(\s*([^)\s]+)\s*\)", page.read_text(encoding="utf-8")):
        if target.startswith("http"):
            continue
        file, _, section = target.partition("#")
        linked = page.parent / file if file else page
        assert linked.exists(), f"{page.name}: {target}"
        if section:
            headings = re.findall(r"^#+ (.+)$", linked.read_text(encoding="utf-8"), re.MULTILINE)
            assert section in {anchor(heading) for heading in headings}, f"{page.name}: {target}"


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.name)
def test_files_that_pages_name_are_there(page: Path) -> None:
    """Modules and folders of the repository, from its root, from `pipeline` on, or by a file's name alone."""
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    paths = {path.removeprefix("pipeline/") for path in listed.splitlines()}
    places = paths | {str(parent) for path in paths for parent in Path(path).parents}
    names = {Path(path).name for path in paths}
    folders = {Path(path).parts[0] for path in paths if "/" in path} - {"artifacts", "data"}
    prose = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    for named in re.findall(r"`([\w./-]+)`", prose):
        path = named.removeprefix("pipeline/").rstrip("/")
        if "/" not in path and path.endswith(".py"):
            assert path in names, named
        elif "/" in path and path.split("/")[0] in folders:
            assert path in places, named


def test_site_has_every_page_and_every_layer() -> None:
    """Also where the site itself is not built."""
    listed = set(re.findall(r"- (\S+\.md)$", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"), re.MULTILINE))
    assert listed == {str(path.relative_to(ROOT / "docs")) for path in (ROOT / "docs").rglob("*.md")}
    documented = set(
        re.findall(
            r"^::: (\S+)$", "\n".join(p.read_text() for p in (ROOT / "docs/api").glob("*.md")), re.MULTILINE
        )
    )
    library = ROOT / "pipeline"
    packages = {f"pipeline.{path.parent.name}" for path in library.glob("*/__init__.py")}
    modules = {f"pipeline.{path.stem}" for path in library.glob("[a-z]*.py")}
    assert documented == packages | modules


def test_python_on_pages_uses_names_that_exist() -> None:
    snippets = [
        (page, snippet)
        for page in PAGES
        for snippet in re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    ]
    assert snippets
    for page, snippet in snippets:
        compile(snippet, str(page), "exec")
        exec("\n".join(re.findall(r"^(?:from|import) .*", snippet, re.MULTILINE)), {})
