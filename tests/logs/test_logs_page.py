"""What docs/logs.md and docs/log_damage.md say is so: snippets are machine configuration, values the profile's."""

import dataclasses
import re

import pytest
import yaml
from omegaconf import OmegaConf

from benchmarks.log_damage import page
from pipeline.configuration.load import load_machine, load_section
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.formats.discovery.log_entry import FORMATS
from pipeline.logs.ingest_config import IngestConfig
from pipeline.logs.messages.command_sources import command_adapter
from pipeline.logs.messages.conversion import discretise
from pipeline.logs.messages.raw_log import NoteKind
from pipeline.machine.log_sources import CommandSourceKind
from pipeline.machine.specification import MachineSpecification
from tests.logs.conftest import REPOSITORY, make_session
from tests.logs.damage import CASES
from tests.logs.samples import foreign_bags as foreign

PAGE = (REPOSITORY / "docs/logs.md").read_text(encoding="utf-8")
DAMAGE_PAGE = (REPOSITORY / "docs/log_damage.md").read_text(encoding="utf-8")
SNIPPETS = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)
SOURCES_TABLE = re.search(r"^\| `source` .*?\n\n", PAGE, re.DOTALL | re.MULTILINE)[0]
SOURCES = {
    source: ", ".join([f"source: {source}", *re.findall(r"`(\w+: [^`]+)`", keys)])
    for source, keys in re.findall(r"^\| `(\w+)` \| .*? \|(.*)\|$", SOURCES_TABLE, re.MULTILINE)
    if source != "source"
}


def machine_with(snippet):
    content = OmegaConf.load(REPOSITORY / "conf/machine/bobcat_e10.yaml")
    merged = OmegaConf.merge(OmegaConf.structured(MachineSpecification), content, yaml.safe_load(snippet))
    return OmegaConf.to_object(merged)


@pytest.mark.parametrize("snippet", SNIPPETS)
def test_snippet_is_machine_configuration(snippet):
    machine, usual = machine_with(snippet), load_machine("bobcat_e10")
    assert machine != usual or "source: array" in snippet
    command_adapter(machine)


def test_the_table_of_command_sources_is_machine_configuration():
    assert set(SOURCES) == set(CommandSourceKind)
    for keys in SOURCES.values():
        command_adapter(machine_with(f"commands: {{topic: /commands, {keys}}}"))


def test_joystick_snippet_reads_a_joystick(tmp_path):
    (snippet,) = [snippet for snippet in SNIPPETS if "source: joy" in snippet]
    machine, session = machine_with(snippet), make_session(load_machine("bobcat_e10"), seconds=3)
    axes = [[0.4, -0.6, 9.0, 0.5, 1.0]] * len(session.command_ns)
    entries = foreign.messages(foreign.ROS2, session, machine.joint_names)
    entries = [entry for entry in entries if entry[1] == "/joint_states"] + [
        (int(time), "/joy", foreign.joy(foreign.ROS2, int(time), values))
        for time, values in zip(session.command_ns, axes, strict=True)
    ]
    foreign.write_mcap(tmp_path / "a.mcap", sorted(entries, key=lambda entry: entry[0]))
    (entry,) = find_logs(tmp_path)
    # Axes 0, 1, 4, 3 are 0.4, -0.6, 1.0, 0.5; the signs turn the second and third; 0.5 is not beyond 0.5.
    assert read_log(entry, machine).command[0].tolist() == [0.0, 1.0, -1.0, 0.0]
    assert discretise(session.command, 0.5).tolist() == session.command.tolist()


def test_column_snippet_reads_a_table(tmp_path):
    (snippet,) = [snippet for snippet in SNIPPETS if snippet.startswith("columns:")]
    machine = machine_with(snippet)
    names = [
        "stamp",
        *(f"{j}_rad" for j in machine.joint_names),
        *(f"{j}_command" for j in machine.joint_names),
    ]
    rows = [f"{1_700_000_000_000_000_000 + i},0.1,0.2,-1.0,-1.0,0,1,0,-1" for i in range(3)]
    (tmp_path / "a.csv").write_text("\n".join([",".join(names), *rows]))
    (entry,) = find_logs(tmp_path)
    raw = read_log(entry, machine)
    assert raw.joint_log_time_ns.tolist() == [1_700_000_000_000_000_000 + i for i in range(3)]
    assert raw.q[0].tolist() == [0.1, 0.2, -1.0, -1.0] and raw.command[0].tolist() == [0, 1, 0, -1]


def test_values_are_those_of_the_profile():
    """Every threshold stands in the table of rules, with its value."""
    config = load_section("ingest", IngestConfig)
    said = re.findall(r"`(\w+)` \(([\d.]+)(?: s)?\)", PAGE)
    assert {key for key, _ in said} == {field.name for field in dataclasses.fields(config)}
    for key, value in said:
        assert float(value) == getattr(config, key)


def test_formats_and_kinds_of_notes_are_all_named():
    for suffix in FORMATS:
        assert f"{suffix}`" in PAGE
    assert f"kind ({', '.join(f'`{kind}`' for kind in NoteKind)})" in PAGE


def test_links_lead_somewhere():
    for target in re.findall(r"\]\(([^)]+)\)", PAGE):
        assert (REPOSITORY / "docs" / target).exists()


def test_damage_page_is_that_of_the_list():
    """Its rows are the cases in their order; `test_damage.py` compares each row with what the ingest does."""
    rows = [line for line in DAMAGE_PAGE.splitlines() if re.match(r"\| .* \| \d+ \| \d+ \| ", line)]
    assert page(rows) == DAMAGE_PAGE
    cells = [row.removeprefix("| ").split(" | ") for row in rows]
    assert [(name, kind) for name, kind, *_ in cells] == [(case.name, case.kind) for case in CASES]
