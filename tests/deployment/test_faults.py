"""Every fault stops the machine, alone and together with every other one; the page says what these tests see."""

from itertools import combinations
from pathlib import Path

import pytest

from pipeline.deployment.component import NANOSECONDS
from pipeline.deployment.components.supervision.supervisor_rules import RULES
from tests.deployment.fault_cases import CUTS, DELAYS, FAULTS, RULES_TOLD, fault_page, run_faults
from tests.deployment.fault_triples import CONTROL_PERIOD_S, PLC_STOPS_S, are_of_one_clock, findings, sampled

PAGE = Path(__file__).parents[2] / "docs/faults.md"


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_stops_the_machine_within_a_control_period(name: str) -> None:
    run = run_faults(name, seed=7)
    assert run.reaction != "none"
    assert run.stopped_s <= (PLC_STOPS_S if name in CUTS else CONTROL_PERIOD_S)
    assert run.commands_after == run.moves_after == 0


@pytest.mark.long
@pytest.mark.parametrize("first", FAULTS)
def test_faults_in_pairs_stop_it_too(first: str) -> None:
    for a, b in combinations(FAULTS, 2):
        if a != first or are_of_one_clock(a, b):
            continue  # one clock does not step on and back at once
        run = run_faults(a, b, seed=1)
        assert run.reaction != "none", (a, b)
        # what cuts the way to the valves cuts the supervisor's order too
        limit_s = max(PLC_STOPS_S - run.known_s, CONTROL_PERIOD_S) if {a, b} & set(CUTS) else CONTROL_PERIOD_S
        assert run.stopped_s <= limit_s, (a, b)
        assert run.commands_after == run.moves_after == 0, (a, b)


@pytest.mark.parametrize("number", range(5))
def test_faults_in_triples_at_any_phase_stop_it_too(number: int) -> None:
    names, later_ns, seed = sampled(number)
    assert findings(names, later_ns, run_faults(*names, seed=seed, later_ns=later_ns)) == []


def test_a_sound_graph_runs_on_with_every_rule_switched_on() -> None:
    run = run_faults(seed=3, rules=tuple(RULES))
    assert run.reaction == "none"
    assert max(link.quantiles_s[-1] for link in DELAYS.values()) * NANOSECONDS > 0


def test_every_rule_is_told() -> None:
    assert list(RULES_TOLD) == list(RULES)


def test_the_page_is_what_these_runs_give() -> None:
    assert PAGE.read_text(encoding="utf-8") == fault_page(), (
        "run `python -m tests.deployment.fault_cases > docs/faults.md`"
    )
