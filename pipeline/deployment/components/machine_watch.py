"""`machine_watch`: tells whether the machine is as its nominal sessions show it; commands nothing."""

from array import array
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pipeline.deployment.component import (
    NANOSECONDS,
    Computation,
    ComputingComponent,
    Condition,
    Output,
    nanoseconds,
)
from pipeline.deployment.messages import JointState, Level, MachineCommand, Message, Topic
from pipeline.errors import InputError
from pipeline.logs.messages.raw_log import RawLog
from pipeline.watch.course import State
from pipeline.watch.running_session import RunningSession, Standing
from pipeline.watch.watch_inputs import WatchSettings

NAME = "running session"
# A judgement takes time in proportion to the session: with a tenth more motion each time, all of them together take
# some ten times as long as the last one.
GROWTH = 0.1


class MachineWatch(ComputingComponent):
    """Judges the session that began with it, by the statistics of `watch`, while it grows.

    It judges when there is enough new motion, and once more when no joint state has come for as long as splits a log.
    Rows are those of a bag of the same messages, but that joint states are timed by arrival where their stamps cannot
    be used, and that the time since the log's start counts from the first arrival.

    Attributes:
        standing: As of the last judgement; before the first one, without the running session.
    """

    name = "machine_watch"
    subscriptions = (Topic.joint_states, Topic.joint_commands)
    period_ns = nanoseconds(1.0)

    def __init__(self, state: Path, settings: WatchSettings) -> None:
        """A session without a message.

        Args:
            state: Folder that `watch` keeps; it is only read.
            settings: As `watch` has them.

        Raises:
            InputError: The state cannot be used.
        """
        self._running = RunningSession(state, settings)
        self.standing = self._running.before()
        self._machine = settings.machine
        self._every_ns = nanoseconds(settings.watch.live_every_s)
        self._gap_ns = nanoseconds(settings.ingest.maximum_gap_s)
        # of numbers, as a shift's messages take ten times the memory
        self._stamp_ns, self._heard_ns, self._q = array("q"), array("q"), array("d")
        self._command_ns, self._command = array("q"), array("f")
        self._is_commanded = False
        self._motion_ns = self._judged_motion_ns = 0
        self._n_judged = 0  # joint states
        self._is_judging = False
        self._trouble = ""

    def on_message(self, topic: Topic, message: Message, now_ns: int) -> Sequence[Output]:
        """Keep joint states and commands, and count the time under commands."""
        if isinstance(message, MachineCommand):
            self._command_ns.append(message.stamp_ns)
            self._command.extend(np.asarray(message.values, np.float32))
            self._is_commanded = bool(np.any(message.values))
        elif isinstance(message, JointState):
            if self._is_commanded and self._heard_ns:
                self._motion_ns += min(max(now_ns - self._heard_ns[-1], 0), self._gap_ns)
            self._stamp_ns.append(message.stamp_ns)
            self._heard_ns.append(now_ns)
            self._q.extend(np.asarray(message.position, np.float64))
        return ()

    def on_timer(self, now_ns: int) -> Sequence[Output]:
        """Ask for a judgement when it is due."""
        if self._is_judging or not self._heard_ns or not self._command_ns:
            return ()
        is_silent = now_ns - self._heard_ns[-1] > self._gap_ns and self._n_judged < len(self._heard_ns)
        if not is_silent and self._motion_ns < self._due_ns():
            return ()
        self._is_judging = True
        self._judged_motion_ns, self._n_judged = self._motion_ns, len(self._heard_ns)
        return (Computation(self._log()),)

    def compute(self, request: RawLog) -> Standing | InputError:
        """Judge the messages so far."""
        try:
            return self._running.judged(request)
        except InputError as error:
            return error

    def on_computed(self, result: Standing | InputError, now_ns: int) -> Sequence[Output]:
        """Tell it from now on."""
        self._is_judging = False
        if isinstance(result, InputError):
            self._trouble = str(result)
        else:
            self.standing, self._trouble = result, ""
        return ()

    def condition(self, now_ns: int) -> Condition:
        """`unestimated`, `healthy` or `changed`; evidence, and what each joint has moved of what is needed."""
        standing = self.standing
        document, own = standing.document, standing.own
        is_changed = document["state"] == State.changed
        state = _told(State.changed if is_changed else State.not_enough if own is None else own["state"])
        evidence = f"{document['e_value']:.3g} of {document['alarm_at']:g}"
        motion = f"{self._motion_ns / NANOSECONDS:.0f} of {self._due_ns() / NANOSECONDS:.0f} s"
        values = {
            "evidence": evidence,
            "motion until the next judgement": motion,
            "sessions": str(len(document["sessions"])),
            "sessions that do not count": str(standing.left_out),
            **self._of_joints(),
        }
        if self._trouble:
            return Condition(Level.warning, f"{state}: {self._trouble}", values)
        text = f"{state}, evidence {evidence}" if is_changed or own else f"{state}, {motion} of motion"
        return Condition(Level.warning if is_changed else Level.ok, text, values)

    def _of_joints(self) -> dict[str, str]:
        needed_s, own = self._running.least_s, self.standing.own
        told = {}
        for name, has_s in zip(self._machine.joint_names, self.standing.moved_s, strict=True):
            told[name] = f"moved {min(has_s, needed_s):.1f} of {needed_s:g} s"
            if own is not None:
                joint = own["joints"][name]
                told[name] = f"{_told(joint['state'])}, evidence {joint['e_value']:.3g}, {told[name]}"
        return told

    def _due_ns(self) -> int:
        """Motion from which on the next judgement is due."""
        return self._judged_motion_ns + max(self._every_ns, round(GROWTH * self._judged_motion_ns))

    def _log(self) -> RawLog:
        n_joint = self._machine.n_joint
        return RawLog(
            NAME,
            Path(NAME),
            np.array(self._stamp_ns),
            np.array(self._heard_ns),
            np.array(self._q).reshape(-1, n_joint),
            np.array(self._command_ns),
            np.array(self._command, np.float64).reshape(-1, n_joint),
        )


def _told(state: str) -> str:
    return "unestimated" if state == State.not_enough else state
