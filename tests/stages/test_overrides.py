"""What a stage passes on to the commands that it starts arrives as it was meant."""

from dataclasses import dataclass, field

import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser

from pipeline.configuration.overrides import override, replaced, settled
from pipeline.control.icem.variant import RewardVariant

VALUES = [
    "/x/run (1)",
    "a'b",
    'a"b',
    "a,b",
    "a=b",
    "a:b",
    "[a]",
    "{a}",
    "a b",
    "",
    "null",
    "1",
    "a\\",
    "a\\'b",
    "ä",
    "~/x",
    None,
    3,
    0.5,
    True,
    RewardVariant.icem_dagger,
]


@pytest.mark.parametrize("value", VALUES, ids=repr)
def test_hydra_reads_the_value_that_was_meant(value: object) -> None:
    read = OverridesParser.create().parse_override(override("key", value))
    assert read.key_or_group == "key" and not read.is_sweep_override()
    assert read.value() == value and type(read.value()) is type(value if not isinstance(value, str) else "")


def test_own_values_take_the_place_of_those_given() -> None:
    given = ["output=here", "driver=plant", "+model=x", "deployment.seed=3", "driver.rate=1"]
    assert replaced(given, {"driver": "can", "model": "run (1)"}) == [
        "output=here",
        "deployment.seed=3",
        "driver.rate=1",
        "driver='can'",
        "model='run (1)'",
    ]


@dataclass
class Part:
    seed: int = 3


@dataclass
class Whole:
    output: str = "out/1 (a)"
    variant: str | None = None
    part: Part = field(default_factory=Part)


def test_interpolations_are_settled_and_all_else_stays_as_it_was_given() -> None:
    given = ["output=out/${hydra:job.num} (a)", "+part.seed=${x}", "part=${y}", "variant=null", "other='a b'"]
    assert settled(given, Whole()) == [
        "output='out/1 (a)'",
        "part.seed=3",
        "part=${y}",  # of a choice between files there is no value
        "variant=null",
        "other='a b'",
    ]
