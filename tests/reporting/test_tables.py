import json
import statistics

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.reporting.table import Table, mean_and_deviation

TABLE = Table(
    "Success & failure", ["Algo.", "SR(0.02, 0.02)"], [["PPO MLP Δq̇", "0.99 ± 0.01"]], ["100 % simulated"]
)


def test_markdown_is_a_github_table() -> None:
    lines = TABLE.markdown().splitlines()
    assert lines[2:5] == ["| Algo. | SR(0.02, 0.02) |", "| --- | --- |", "| PPO MLP Δq̇ | 0.99 ± 0.01 |"]


def test_latex_escapes_what_latex_would_read_as_markup() -> None:
    latex = TABLE.latex()
    assert r"\caption{Success \& failure}" in latex
    assert r"100 \% simulated" in latex
    assert r"0.99 $\pm$ 0.01 \\" in latex


def test_html_escapes_its_cells() -> None:
    assert "Success &amp; failure" in TABLE.html()


def test_json_keys_cells_by_column() -> None:
    assert json.loads(TABLE.json())["rows"] == [{"Algo.": "PPO MLP Δq̇", "SR(0.02, 0.02)": "0.99 ± 0.01"}]


def test_a_row_of_another_length_is_refused() -> None:
    with pytest.raises(ValueError, match="2 cells, the table 1 columns"):
        Table("t", ["a"], [["1", "2"]])


@settings(deadline=None)
@given(st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=6))
def test_mean_and_deviation_are_those_of_the_sample(values: list[float]) -> None:
    mean, deviation = mean_and_deviation(values, digits=6).split(" ± ")
    assert float(mean) == pytest.approx(statistics.mean(values), abs=2e-6)
    assert float(deviation) == pytest.approx(statistics.stdev(values), abs=2e-6)


GROUPED = Table(
    "Grouped",
    ["Algo.", "Whose", "Min. z [m]"],
    [
        ["PPO", "ours", "-0.10 ± 0.02"],
        ["PPO", "paper", "r^X, W+"],
        ["iCEM†", "ours", "3 × 4"],
        ["iCEM†", "ours", "–"],
    ],
    merged=2,
    rules=[2, 3],
)


def test_repeated_cells_are_printed_once_until_a_rule() -> None:
    first_cells = [line.split("|")[1].strip() for line in GROUPED.markdown().splitlines()[4:8]]
    assert first_cells == ["PPO", "", "iCEM†", "iCEM†"]
    assert [row["Algo."] for row in json.loads(GROUPED.json())["rows"]] == ["PPO", "PPO", "iCEM†", "iCEM†"]
    assert GROUPED.html().count("class='ruled'") == 2


def test_latex_has_the_papers_symbols_rules_and_minus_signs() -> None:
    lines = GROUPED.latex().splitlines()
    body = lines[lines.index(r"\toprule") + 2 : lines.index(r"\bottomrule")]
    assert body == [
        r"PPO & ours & $-$0.10 $\pm$ 0.02 \\",
        r" & paper & $r_t^{\mathcal{X}}$, $\mathcal{W}^{+}$ \\",
        r"\midrule",
        r"iCEM$^{\dagger}$ & ours & 3 $\times$ 4 \\",
        r"\midrule",
        r"iCEM$^{\dagger}$ & ours & -- \\",
    ]
    assert GROUPED.latex().isascii()


def test_html_raises_superscripts_and_nothing_else() -> None:
    assert "r<sup>X</sup>, W+" in GROUPED.html()
