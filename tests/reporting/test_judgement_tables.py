"""Who wins, in words and in the table."""

import numpy as np

from pipeline.reporting.tables.judgement import ReferenceComparison

REFERENCES = ["arx_dq", "grey_box"]


def comparison(*rows, **changes) -> ReferenceComparison:
    named = [(key, dict(zip(["mlp_dq", "kan_dq", *REFERENCES], values, strict=True))) for key, values in rows]
    return ReferenceComparison("Errors", named, REFERENCES, **changes)


LIFT, TURN = ("one step", "lift", "m"), ("one step", "turn", "rad")
FAR = ("far", "lift", "m")


def test_a_reference_that_wins_is_counted_above_and_named_in_the_table():
    text = comparison((LIFT, [2.0, 3.0, 1.0, 4.0]), (TURN, [1.0, 3.0, 2.0, 4.0])).markdown()
    first, *_ = text.splitlines()
    assert first.startswith("A reference is better than every model on 1 of these 2 figures.")
    assert "MLP Δq on 1, KAN Δq on 2" in first
    assert "| one step | lift [m] | 2 | 3 | **1** | 4 | reference: ARX Δq |" in text
    assert "| one step | turn [rad] | **1** | 3 | 2 | 4 | MLP Δq |" in text


def test_no_reference_wins():
    compared = comparison((LIFT, [2.0, 0.5, 1.0, 4.0]))
    assert compared.won_by_references() == []
    assert compared.sentence().startswith(
        "No reference is better than the best model on any of these 1 figures."
    )


def test_ties_are_ties():
    assert "| **0** | 1 | **0** | 2 | tie |" in comparison((LIFT, [0.0, 1.0, 0.0, 2.0])).markdown()
    both = comparison((LIFT, [1.0, 1.0, 0.0, 0.0]))
    assert both.won_by_references() == [("one step", "lift", ["arx_dq", "grey_box"])]
    assert "reference: ARX Δq, grey box" in both.markdown()


def test_what_could_not_be_measured_never_wins():
    compared = comparison((LIFT, [2.0, np.nan, np.nan, 4.0]))
    assert "| **2** | – | – | 4 | MLP Δq |" in compared.markdown()


def test_differences_that_say_nothing_win_nothing():
    compared = comparison((FAR, [0.9, 1.2, 0.5, 0.4]), indifferent_below={"far": 1.0})
    assert compared.won_by_references() == []
    assert "| **0.9** | 1.2 | **0.5** | **0.4** | tie |" in compared.markdown()


def test_tidy_rows_keep_every_digit():
    header, rows = comparison((LIFT, [0.1 + 0.2, 1.0, 2.0, 3.0])).tidy()
    assert header == ["predictor", "quantity", "joint", "unit", "value"]
    assert rows[0] == ["mlp_dq", "one step", "lift", "m", "0.30000000000000004"]
    assert len(rows) == 4
