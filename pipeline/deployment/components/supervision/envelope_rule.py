"""The rule of the envelope: the arm stays in the region in which experiments are planned."""

import numpy as np

from pipeline.deployment.components.supervision.rule import Rule
from pipeline.deployment.messages import JointState
from pipeline.machine.workspace import Envelope


class StaysInEnvelope(Rule):
    """The arm does not leave the envelope, nor would at its present velocity. One outside may come in first."""

    def __init__(self, envelope: Envelope, prediction_s: float = 0.0) -> None:
        """A rule of a region, with the prediction's horizon; joints end at their limits."""
        self._envelope = envelope
        self._prediction_s = prediction_s
        self._state: JointState | None = None
        self._was_inside = False

    def on_state(self, state: JointState, now_ns: int) -> str | None:
        """Look at a joint state."""
        self._state = state
        return None

    def on_tick(self, now_ns: int) -> str | None:
        """Check the newest state: they arrive more often than necessary."""
        state, self._state = self._state, None
        if state is None or not np.isfinite(state.position).all():
            return None
        is_inside = self._envelope.holds(state.position)
        stays = is_inside
        if is_inside and self._prediction_s and np.isfinite(state.velocity).all():
            stays = self._envelope.holds(
                self._envelope.ahead(state.position, state.velocity, self._prediction_s)
            )
        if self._was_inside and not stays:
            return f"the arm leaves the envelope at {np.round(state.position, 3).tolist()}"
        self._was_inside |= is_inside
        return None
