"""The envelope: W+ of the reference kinematics, widened as the operator says."""

import dataclasses
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.deployment.components.supervision.envelope_rule import StaysInEnvelope
from pipeline.deployment.messages import JointState
from pipeline.errors import InputError
from pipeline.machine.workspace import Envelope, EnvelopeConfig, depths, workspace_of
from tests.deployment.machines import MIDDLE, arm, bobcat, paper

SHARES = st.lists(st.floats(0.0, 1.0), min_size=4, max_size=4)
WIDER_M, WIDER_RAD = 0.2, 0.1


@cache
def region(wider_m: float = 0.0) -> Envelope:
    return Envelope(bobcat(), arm(), EnvelopeConfig(wider_m, 0.0, {}))


def depth_m(q: np.ndarray) -> float:
    """Distance to the nearest face of W+; negative outside."""
    pose = arm().forward(jnp.asarray(q))
    return float(min(depths(workspace_of(bobcat()), pose.position, arm().yaw(jnp.asarray(q)))))


def state(q: np.ndarray) -> JointState:
    return JointState(0, np.asarray(q, float), np.zeros(4))


@given(SHARES)
def test_the_envelope_is_where_every_face_of_the_workspace_is_outside(shares: list[float]) -> None:
    q = bobcat().lower + np.array(shares) * (bobcat().upper - bobcat().lower)
    if abs(depth := depth_m(q)) > 1e-4:
        assert region().holds(q) == (depth > 0)
        assert not region().holds(q) or region(WIDER_M).holds(q)
        if abs(bobcat().upper[0] * (2 * shares[0] - 1)) < workspace_of(bobcat()).yaw_max_rad:
            assert region(WIDER_M).holds(q) or depth < -WIDER_M / 2


def test_bounds_of_joints_hold_beside_the_region_of_the_tip() -> None:
    narrow = Envelope(bobcat(), arm(), EnvelopeConfig(0.0, 0.0, {"swing": [-0.5, -0.1]}))
    assert region().holds(MIDDLE) and not narrow.holds(MIDDLE)
    assert narrow.holds(MIDDLE - np.array([0.3, 0, 0, 0]))


@pytest.mark.parametrize(
    ("path", "objects"),
    [
        ([MIDDLE, bobcat().lower], [False, True]),
        ([bobcat().lower, MIDDLE, bobcat().lower], [False, False, True]),  # it may come in first
        ([MIDDLE, np.full(4, np.nan), MIDDLE], [False, False, False]),
    ],
)
def test_the_arm_may_come_in_but_not_leave(path: list[np.ndarray], objects: list[bool]) -> None:
    rule = StaysInEnvelope(region())
    heard = []
    for q in path:
        assert rule.on_state(state(q), 0) is None
        heard.append(rule.on_tick(0) is not None)
        assert rule.on_tick(1) is None  # nothing new was measured
    assert heard == objects


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"wider_m": -0.1}, "envelope.wider_m is -0.1"),
        ({"wider_rad": np.nan}, "envelope.wider_rad is nan"),
        ({"joints": {"boom": [1.0, 0.0]}}, r"joints.boom is \[1.0, 0.0\]"),
        ({"joints": {"boom": [1.0]}}, r"joints.boom is \[1.0\]"),
        ({"joints": {"hand": [0.0, 1.0]}}, "no joint `hand`; known are swing, boom"),
    ],
)
def test_what_is_no_region_is_refused(changes: dict, fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        Envelope(bobcat(), arm(), dataclasses.replace(paper().supervisor.envelope, **changes))


def test_every_face_of_the_region_lies_further_out_by_as_much_as_asked() -> None:
    """Against the bounds of W+, written down again, of configurations all over the joints' ranges."""
    wider = Envelope(bobcat(), arm(), EnvelopeConfig(WIDER_M, WIDER_RAD, {}))
    w, shares = workspace_of(bobcat()), np.random.default_rng(0).uniform(size=(4000, 4))
    q = (bobcat().lower + shares * (bobcat().upper - bobcat().lower)).astype(np.float32)
    tip, yaw = (np.asarray(part) for part in jax.vmap(lambda q: (arm().forward(q).position, arm().yaw(q)))(q))
    radius, is_in_front = np.hypot(tip[:, 0], tip[:, 1]), np.cos(np.arctan2(tip[:, 1], tip[:, 0]) - yaw) > 0
    excess = np.stack(  # over each face of W+; negative inside
        [
            (w.radius_min_m - radius) / WIDER_M,
            (radius - w.radius_max_m) / WIDER_M,
            (w.z_min_m - tip[:, 2]) / WIDER_M,
            (tip[:, 2] - w.z_max_m) / WIDER_M,
            (np.abs(yaw) - w.yaw_max_rad) / WIDER_RAD,
        ],
        axis=1,
    )
    for face in range(5):
        others = np.delete(excess, face, axis=1).max(axis=1)
        for beyond, holds in (((0.02, 0.98), True), ((1.02, 2.0), False)):
            is_near = (excess[:, face] > beyond[0]) & (excess[:, face] < beyond[1])
            rows = np.flatnonzero(is_near & (others < -0.02) & is_in_front)[:5]
            if holds:
                assert len(rows) or (face == 4 and bobcat().upper[0] <= w.yaw_max_rad), face
            assert all(wider.holds(q[row].astype(float)) == holds for row in rows), (face, beyond)


def test_bounds_belong_to_the_region() -> None:
    for bounds in ([float(MIDDLE[0]), 1.0], [-1.0, float(MIDDLE[0])]):
        assert Envelope(bobcat(), arm(), EnvelopeConfig(0.0, 0.0, {"swing": bounds})).holds(MIDDLE)


def test_an_arm_that_left_is_told_with_its_place_until_it_is_back() -> None:
    rule, said = StaysInEnvelope(region()), []
    for q in (MIDDLE, bobcat().lower, bobcat().lower, MIDDLE):
        rule.on_state(state(q), 0)
        said.append(rule.on_tick(0))
    place = np.round(bobcat().lower, 3).tolist()
    assert said == [None, *[f"the arm leaves the envelope at {place}"] * 2, None]


def test_an_arm_is_stopped_before_it_leaves() -> None:
    moving = JointState(0, np.asarray(MIDDLE, float), (bobcat().lower - MIDDLE) / 0.15)
    for prediction_s, objects in ((0.0, False), (0.15, True)):
        rule = StaysInEnvelope(region(), prediction_s)
        said = []
        for at in (state(MIDDLE), state(MIDDLE), moving):
            rule.on_state(at, 0)
            said.append(rule.on_tick(0) is not None)
        assert said == [False, False, objects]
