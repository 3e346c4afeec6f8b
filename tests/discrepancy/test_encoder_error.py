"""Stops that are read elsewhere: which cause the speeds choose, and what happens where a cause is left out."""

import numpy as np
import pytest

from pipeline.discrepancy.encoder_error import encoder_errors
from pipeline.discrepancy.scored_rows import rows_in_blocks
from pipeline.discrepancy.stops import Encoder, EncoderError

from .exact_machine import N_JOINT, SPEED, held_commands, simulation_of

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
