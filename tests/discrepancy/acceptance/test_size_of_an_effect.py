"""Which sizes are told from none."""

import pytest

from pipeline.discrepancy.acceptance.size_of_an_effect import why_it_is_none

OF_COMMAND = "mean_extra_time_of_command"


def told(value: float, lower: float, upper: float, unit: str = "s") -> dict:
    return {"value": value, "unit": unit, "ci95": [lower, upper]}


@pytest.mark.parametrize(
    ("family", "parameters", "is_none"),
    [
        ("delay", {"added_delay": told(0.1, 0.05, 0.15)}, False),
        ("delay", {"added_delay": told(0.02, 0.0, 0.06)}, True),
        ("lag", {"added_time_constant": told(-0.1, -0.2, -0.01)}, False),
        ("leakage", {"sag_rate": told(0.01, -0.01, 0.03, "rad/s")}, True),
        ("stiction", {"mean_extra_time": told(0.1, 0.0, 0.3)}, True),
        ("stiction", {"mean_extra_time": told(0.1, 0.05, 0.3), OF_COMMAND: told(0.1, 0.0, 0.2)}, True),
        ("stiction", {"mean_extra_time": told(0.2, 0.0, 0.4), OF_COMMAND: told(0.1, 0.05, 0.2)}, False),
        ("flow_coupling", {"loss_fraction": told(0.31, 0.31 - 0.196, 0.31 + 0.196, "1")}, False),
        ("flow_coupling", {"loss_fraction": told(0.29, 0.29 - 0.196, 0.29 + 0.196, "1")}, True),
    ],
)
def test_a_size_whose_interval_holds_none_is_none(family: str, parameters: dict, is_none: bool) -> None:
    assert (why_it_is_none(family, parameters, 3.0, [0]) is not None) == is_none


@pytest.mark.parametrize(
    ("time_s", "joints", "is_none"),
    [(3.0, [0, 1], False), (3.0, [0], True), (0.5, [0, 1, 2, 3], True)],
)
def test_a_supply_is_of_several_joints_and_slower_than_they_start(time_s, joints, is_none) -> None:
    parameters = {"std_log_speed": told(0.1, 0.05, 0.15, "1"), "correlation_time": told(time_s, 0.4, 6.0)}
    assert (why_it_is_none("supply_variation", parameters, 3.0, joints) is not None) == is_none
