"""What docs/effects.md says of the catalogue is what the cards say."""

import re
from pathlib import Path

from pipeline.effects.catalogue import CATALOGUE
from pipeline.effects.dependence import DEPENDENCES
from pipeline.reporting.tables.effect_catalogue import COLUMNS, catalogue_table

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "effects.md").read_text(encoding="utf-8")


def test_the_table_is_that_of_the_cards():
    assert catalogue_table() in PAGE, (
        "put the output of `python -m pipeline.reporting.tables.effect_catalogue` there"
    )


def test_every_card_is_a_row_of_whole_cells():
    rows = catalogue_table().splitlines()[2:]
    assert [re.match(r"\| `(\w+)` \|", row).group(1) for row in rows] == list(CATALOGUE)
    assert all(len(re.findall(r"(?<!\\)\|", row)) == len(COLUMNS) + 1 for row in rows)


def test_the_variables_of_other_are_listed():
    for dependence in DEPENDENCES.values():
        assert f"`{dependence.variable}`" in PAGE
