"""Stops that are read elsewhere: which cause the speeds choose, and what happens where a cause is left out."""

import numpy as np
import pytest

from pipeline.discrepancy.diagnosis.scored_rows import rows_in_blocks
from pipeline.discrepancy.families.encoder_error import encoder_errors, is_refuted_by_stops
from pipeline.discrepancy.families.stops import Encoder, EncoderError
from pipeline.discrepancy.selection.selected_effect import SelectedEffect
from tests.discrepancy.bare_candidate import bare_candidate
from tests.discrepancy.exact_machine import N_JOINT, SPEED, held_commands, simulation_of

N_ROWS, BLOCK_ROWS, SCALE = 2000, 100, 0.8


def told(families: list[str], scale: float, inward: float, excluded: list[str]) -> tuple[list, list[str]]:
    """What is found on a machine whose first encoder reads speeds and stops `scale` times as large."""
    command = held_commands(3, N_ROWS)
    velocity = np.where(np.arange(N_JOINT) == 0, scale, 1.0) * SPEED * command
    simulation = simulation_of(families, command, velocity)
    is_used = np.ones((1, N_ROWS), bool)
    fold = np.arange(N_ROWS)[None] // BLOCK_ROWS % 2
    rows = rows_in_blocks(is_used, fold, np.ones((1, N_ROWS, N_JOINT), bool), np.ones(N_JOINT), BLOCK_ROWS)
    encoder = Encoder((EncoderError({"scale": SCALE}, 0.01),), 20.0, inward, np.zeros((0, 3)))
    said: list[str] = []
    return encoder_errors(simulation, rows, {0: encoder}, excluded, ["lift", "turn"], said.append), said


@pytest.mark.parametrize("excluded", [[], ["backlash"]])
def test_an_encoder_that_is_turned_less_is_found_whether_play_is_tried_or_not(excluded: list[str]) -> None:
    families = [f for f in ("sensor_bias", "backlash") if f not in excluded]
    found, said = told(families, SCALE, 0.1, excluded)
    assert [(f.candidate.family, f.candidate.joint, f.candidate.point) for f in found] == [
        ("sensor_bias", 0, {"scale": SCALE})
    ]
    assert "its encoder" in said[0]


def test_where_speeds_stay_as_they_were_the_stops_alone_do_not_name_a_scale() -> None:
    found, said = told(["sensor_bias"], 1.0, 0.0, ["backlash"])
    assert found == [] and "speak against" in said[0]


def test_left_out_is_left_out() -> None:
    assert told(["backlash"], SCALE, 0.1, ["sensor_bias"]) == ([], [])


MOVED = Encoder((EncoderError({"scale": SCALE}, 0.01),), 20.0, 0.0, np.array([[1.0, SCALE, 0.01]]))
STILL = Encoder((), 0.1, 0.0, np.array([[1.0, 1.0, 0.01]]))


def test_stops_speak_against_errors_of_encoders_that_would_have_moved_them_elsewhere() -> None:
    for scale, encoder, expected in (
        (SCALE, MOVED, False),
        (1.0, MOVED, True),
        (SCALE, STILL, True),
        (1.0, STILL, False),
    ):
        candidate = bare_candidate("sensor_bias", 0, scale=scale)
        assert is_refuted_by_stops(candidate, {0: encoder}, [], []) is expected
        assert not is_refuted_by_stops(candidate, {1: encoder}, [], [])  # stops were not met


def test_beside_play_stops_say_nothing_of_an_encoder() -> None:
    candidate = bare_candidate("sensor_bias", 0, scale=SCALE)
    for joint, expected in ((0, True), (1, False)):
        play = [SelectedEffect(bare_candidate("backlash", joint))]
        assert is_refuted_by_stops(candidate, {0: MOVED}, play, []) is expected


def test_where_encoders_are_left_out_moved_stops_are_no_gain() -> None:
    for encoder, excluded, expected in (
        (MOVED, ["sensor_bias"], True),
        (MOVED, [], False),
        (STILL, ["sensor_bias"], False),
    ):
        assert is_refuted_by_stops(bare_candidate("gain", 0), {0: encoder}, [], excluded) is expected
    assert not is_refuted_by_stops(bare_candidate("load", 0), {0: MOVED}, [], ["sensor_bias"])
