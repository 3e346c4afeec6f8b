"""The base of the supervisor's rules, independent of clocks and transports."""

from pipeline.deployment.messages import JointCommand, JointState


class Rule:
    """Base of all rules, which never reports a violation."""

    def on_command(self, command: JointCommand, now_ns: int) -> str | None:
        """Check a command at its arrival."""
        return None

    def on_state(self, state: JointState, now_ns: int) -> str | None:
        """Check a joint state at its arrival."""
        return None

    def on_tick(self, now_ns: int) -> str | None:
        """Check at a tick."""
        return None
