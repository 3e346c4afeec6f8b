"""Sections `deployment` and `coverage` of a profile."""

from dataclasses import dataclass

import numpy as np

from pipeline.errors import InputError
from pipeline.machine.specification import MachineSpecification
from pipeline.machine.workspace import EnvelopeConfig


def _check_positive(section: object, place: str, *names: str) -> None:
    for name in names:
        value = getattr(section, name)
        if not value > 0:
            raise InputError(f"deployment.{place}.{name} is {value}; it must be positive")


@dataclass
class TerminationConfig:
    """When the autonomous server ends a goal by itself; the time-out is `episodes.steps`.

    Attributes:
        at_goal: end on reaching the target.
        position_tolerance_m: distance below which the target is reached, ...
        pitch_tolerance_rad: ... together with the absolute error in pitch.
        outside_workspace: end on leaving W+ (an arm that begins outside may come in first).
        on_oscillation: end on oscillation.
        oscillation_window_s: time window of the commands.
        oscillation_reversals: smallest number of reversals of one joint's command within the window.
    """

    at_goal: bool
    position_tolerance_m: float
    pitch_tolerance_rad: float
    outside_workspace: bool
    on_oscillation: bool
    oscillation_window_s: float
    oscillation_reversals: int

    def __post_init__(self) -> None:
        names = (
            "position_tolerance_m",
            "pitch_tolerance_rad",
            "oscillation_window_s",
            "oscillation_reversals",
        )
        _check_positive(self, "termination", *names)


@dataclass
class SupervisorConfig:
    """Limits of the supervisor's rules; `rules` names the active ones.

    Attributes:
        rules: any of `supervisor_rules.RULES`; none for the paper's experiments.
        warnings: those of the rules that warn where they would stop the machine.
        period_s: period of its timer and its sign of life.
        maximum_command_gap_s: between two commands of a server that has not fallen silent.
        maximum_command_rate_hz: mean over a second.
        maximum_command_delay_s: from sending to arrival.
        maximum_decision_age_s: age of the joint state of a decision.
        maximum_state_gap_s: between two joint states.
        maximum_state_delay_s: from sampling to arrival.
        clock_tolerance_s: largest lead of a stamp over the clock.
        maximum_speed: of a joint, in joint ranges per second; faster is a jump of the encoder.
        jump_tolerance: allowance for noise, as a share of the joint's range.
        frozen_command: command, as a share of the full one, from which a joint has to move; proportional valves have a
            dead band.
        frozen_after_s: time after which an unchanged reading of a commanded joint counts as frozen.
        limit_tolerance: allowed excess over a joint limit, as a share of its range.
        limit_prediction_s: prediction horizon of the limits at the present velocity; zero if limits are end stops,
            which ordinary operation reaches.
        maximum_stop_s: longest command of a joint at an end stop, during which oil flows over the relief valve.
        prediction_s: prediction horizon of self-collision at the present velocity.
        clearance_m: least distance between links that are not neighbours.
        neutral_s: time for which sticks and commands are neutral before an acknowledged stop is released.
        floor: file of `measure_floor` for the model that the graph is given; without it `model_residual` is off.
        false_stop_hours: least mean time between false stops by `model_residual`, while all joints move.
        envelope: region of the rule `envelope`.
        envelope_prediction_s: prediction horizon of that rule at the present velocity.
    """

    rules: list[str]
    warnings: list[str]
    period_s: float
    maximum_command_gap_s: float
    maximum_command_rate_hz: float
    maximum_command_delay_s: float
    maximum_decision_age_s: float
    maximum_state_gap_s: float
    maximum_state_delay_s: float
    clock_tolerance_s: float
    maximum_speed: float
    jump_tolerance: float
    frozen_command: float
    frozen_after_s: float
    limit_tolerance: float
    limit_prediction_s: float
    maximum_stop_s: float
    prediction_s: float
    clearance_m: float
    neutral_s: float
    floor: str | None
    false_stop_hours: float
    envelope: EnvelopeConfig
    envelope_prediction_s: float

    def __post_init__(self) -> None:
        if others := [name for name in self.warnings if name not in self.rules]:
            raise InputError(f"deployment.supervisor.warnings: {', '.join(others)} not among its rules")
        _check_positive(
            self,
            "supervisor",
            "false_stop_hours",
            "period_s",
            "maximum_command_gap_s",
            "maximum_command_rate_hz",
            "maximum_command_delay_s",
            "maximum_decision_age_s",
            "maximum_state_gap_s",
            "maximum_state_delay_s",
            "maximum_speed",
            "frozen_command",
            "frozen_after_s",
            "maximum_stop_s",
            "neutral_s",
        )
        for name in (
            "clock_tolerance_s",
            "jump_tolerance",
            "limit_tolerance",
            "limit_prediction_s",
            "prediction_s",
            "clearance_m",
            "envelope_prediction_s",
        ):
            if not getattr(self, name) >= 0:
                raise InputError(
                    f"deployment.supervisor.{name} is {getattr(self, name)}; it must not be negative"
                )


@dataclass
class InterfaceConfig:
    """Settings of the control interface.

    Attributes:
        supervised: mute without a sign of life from the supervisor.
        maximum_supervisor_silence_s: longest time without a sign of life.
        period_s: timer period.
    """

    supervised: bool
    maximum_supervisor_silence_s: float
    period_s: float

    def __post_init__(self) -> None:
        _check_positive(self, "interface", "maximum_supervisor_silence_s", "period_s")


@dataclass
class DriverConfig:
    """Settings of the drivers and the machine's controller.

    Attributes:
        command_timeout_s: time without a command (a frame) after which outputs are zeroed.
        can_period_s: polling period of the CAN driver, and cycle of the machine's controller.
    """

    command_timeout_s: float
    can_period_s: float

    def __post_init__(self) -> None:
        _check_positive(self, "driver", "command_timeout_s", "can_period_s")


@dataclass
class TeleoperationConfig:
    """Settings of the joystick's interpreter: the sticks' axes, in joint order.

    Attributes:
        axes: index of each axis; a machine with fewer joints uses the first ones.
        signs: 1 or -1 per axis.
        threshold: deflection from which a discrete command acts.
        maximum_silence_s: time without messages after which the sticks count as released.
    """

    axes: list[int]
    signs: list[float]
    threshold: float
    maximum_silence_s: float

    def __post_init__(self) -> None:
        _check_positive(self, "teleoperation", "threshold", "maximum_silence_s")
        if len(self.axes) != len(self.signs):
            raise InputError(
                f"deployment.teleoperation has {len(self.axes)} axes and {len(self.signs)} signs; "
                "give one sign per axis"
            )

    def sticks(self, machine: MachineSpecification) -> tuple[np.ndarray, np.ndarray]:
        """Axis and sign of each joint, (n_joint,) each.

        Raises:
            InputError: the machine has more joints than the sticks have axes.
        """
        if len(self.axes) < machine.n_joint:
            raise InputError(
                f"deployment.teleoperation.axes has {len(self.axes)} entries; "
                f"machine {machine.name} has {machine.n_joint} joints: give one axis and one sign for each"
            )
        return np.array(self.axes[: machine.n_joint]), np.array(self.signs[: machine.n_joint])


@dataclass
class DeploymentConfig:
    """Section `deployment` of a profile.

    Attributes:
        seed: seed of delays, jitter and phases in simulated time, and of a planner's samples.
        delays: file of measured delays, written by `measure_delays`.
        unmeasured_planning_s: assumed decision time of a planner whose budget and network are missing in the file; null
            requires the file to have them.
        targets: successive targets of the stand-in for Sim2Real.
        planner_episodes: number of fixed episodes for a planner in Sim2Sim, from the first on.
        planner_targets: successive targets of a planner.
        termination: terminal conditions of goals.
        supervisor: limits of the supervisor's rules.
        interface: settings of the control interface.
        driver: settings of the drivers.
        teleoperation: settings of the joystick.
    """

    seed: int
    delays: str
    unmeasured_planning_s: float | None
    targets: int
    planner_episodes: int
    planner_targets: int
    termination: TerminationConfig
    supervisor: SupervisorConfig
    interface: InterfaceConfig
    driver: DriverConfig
    teleoperation: TeleoperationConfig

    def __post_init__(self) -> None:
        for name in ("targets", "planner_episodes", "planner_targets"):
            if getattr(self, name) < 1:
                raise InputError(f"deployment.{name} is {getattr(self, name)}; it must be at least 1")
        if self.unmeasured_planning_s is not None and not self.unmeasured_planning_s >= 0:
            raise InputError(
                f"deployment.unmeasured_planning_s is {self.unmeasured_planning_s}; it must not be negative"
            )


@dataclass
class CoverageConfig:
    """Section `coverage` of a profile.

    Attributes:
        cell_m: longest edge of a cell.
        pitch_bin_rad: widest bin of pitch.
        pitch_max_rad: largest absolute pitch that counts.
        samples_per_cell: sampled configurations per cell and bin, by which is found what the machine can reach.
    """

    cell_m: float
    pitch_bin_rad: float
    pitch_max_rad: float
    samples_per_cell: int

    def __post_init__(self) -> None:
        for name in ("cell_m", "pitch_bin_rad", "pitch_max_rad", "samples_per_cell"):
            if not getattr(self, name) > 0:
                raise InputError(f"coverage.{name} is {getattr(self, name)}; it must be positive")
