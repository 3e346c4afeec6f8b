"""Section `apg` of a profile."""

from dataclasses import dataclass

from pipeline.errors import InputError


@dataclass
class ObjectiveConfig:
    """What a policy minimises; see `objective.cost`.

    Attributes:
        tolerance: errors below it cost nothing, m and rad.
        log_floor: ε of log(error + ε), m and rad: how near to the tolerance an error still pulls harder.
        position_log_weight: of the logarithm of the tip's distance.
        pitch_log_weight: of the logarithm of the pitch error.
        edge_margin_m: depth inside W+ above which its edges cost nothing.
        edge_weight: per metre that is missing to that depth.
        change_weight: of a squared change of command, per joint and decision.
    """

    tolerance: float
    log_floor: float
    position_log_weight: float
    pitch_log_weight: float
    edge_margin_m: float
    edge_weight: float
    change_weight: float

    def __post_init__(self) -> None:
        _check_positive("apg.objective", self, ["log_floor"])
        for name, value in vars(self).items():
            if not value >= 0.0:
                raise InputError(f"apg.objective.{name} is {value}; it must not be negative")


@dataclass
class APGConfig:
    """Section `apg` of a profile.

    Attributes:
        training_steps: ticks of all episodes together, action repeats included; rounded up to whole updates between two
            points of the curve.
        environments: episodes that run side by side.
        horizon: decisions that a gradient goes through.
        discount: γ, per decision.
        feedback: share of the gradient that goes through what the policy observes. At 1 it is the whole gradient. At 0
            later commands count as fixed, as in a plan.
        step_slope: slope of the smooth step that gives discrete commands their gradient.
        between: whether the model's gradient is taken between discrete commands, not at them; see `rollout.py`.
        noise: standard deviation of the noise on proto-actions, at the start.
        final_noise: the same at the end, linear in between.
        learning_rate: of Adam, after the warm-up.
        final_learning_rate: at the end, along a cosine.
        warm_up_updates: updates in which the learning rate rises from 0.
        second_moment_decay: β₂ of Adam.
        gradient_norm: longer gradients are shortened to it.
        averaging: share of the old average when a new update's weights are averaged in; the average is evaluated and
            kept. At 0 it is the newest.
        hidden: units of the policy's hidden layers (SiLU).
        error_gain: factor on the differences between target and state in the first layer.
        curve_points: points of the learning curve after the first, evenly spaced.
        curve_episodes: fixed episodes that each point is measured over.
        objective: what is minimised.
    """

    training_steps: int
    environments: int
    horizon: int
    discount: float
    feedback: float
    step_slope: float
    between: bool
    noise: float
    final_noise: float
    learning_rate: float
    final_learning_rate: float
    warm_up_updates: int
    second_moment_decay: float
    gradient_norm: float
    averaging: float
    hidden: list[int]
    error_gain: float
    curve_points: int
    curve_episodes: int
    objective: ObjectiveConfig

    def __post_init__(self) -> None:
        positive = (
            "training_steps environments horizon step_slope learning_rate gradient_norm error_gain curve_points "
            "curve_episodes"
        )
        _check_positive("apg", self, positive.split())
        for name in ("discount", "feedback", "second_moment_decay", "averaging"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise InputError(f"apg.{name} is {getattr(self, name)}; it must be in [0, 1]")
        for name in ("noise", "final_noise", "final_learning_rate", "warm_up_updates"):
            if not getattr(self, name) >= 0:
                raise InputError(f"apg.{name} is {getattr(self, name)}; it must not be negative")
        if not self.hidden or min(self.hidden) < 1:
            raise InputError(f"apg.hidden is {self.hidden}; list the units of at least one layer")


def _check_positive(section: str, config: object, names: list[str]) -> None:
    for name in names:
        if not getattr(config, name) > 0:
            raise InputError(f"{section}.{name} is {getattr(config, name)}; it must be positive")
