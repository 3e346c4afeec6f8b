"""The paper's published figures, for comparison with ours.

Tables "Evaluation results obtained in the Brax-based training environment", "Performance of the PPO MLP policy when
trained using different reward functions", "Selected parameterizations and training hyperparameters for the dynamic
models", "Modeling and algorithms hyperparameters", and those of sections "Sim2Sim transfer" and "Sim2Real transfer".
"""

from typing import NamedTuple

KIND_NAMES = {"mlp_dq": "MLP Δq", "mlp_dqdot": "MLP Δq̇", "kan_dq": "KAN Δq", "kan_dqdot": "KAN Δq̇"} | {
    "nfir_dqdot": "NFIR q̇"  # not in the paper
}
ALGORITHM_NAMES = {
    "ppo": "PPO",
    "apg": "APG",  # not in the paper
    "ppo_warm": "PPO from APG",  # not in the paper
    "icem": "iCEM",
    "icem_dagger": "iCEM†",
    "icem_double_dagger": "iCEM‡",
}

# Name in our metrics.json, heading of the paper's column, in the paper's order.
METRIC_COLUMNS = {
    "average_return": "Avg. return",
    "sr_002_002": "SR(0.02, 0.02)",
    "sr_004_004": "SR(0.04, 0.04)",
    "oow": "OOW",
    "ooz": "OOZ",
    "min_z_m": "Min. z [m]",
    "path_length_m": "EEF-PL [m]",  # only in the reward ablation
}
PAPER_SEEDS, PAPER_EPISODES = 5, 500
# Difference between our machine and the paper's.
SIMULATED = "the paper's is a real Bobcat E10, ours a simulated one with assumed geometry"
OWN = "the paper's is a Bobcat E10, ours another"


RECORDED = "data/raw/sessions"  # logs of the stage `record`


def origin_of(logs: str) -> str:
    """Origin of the logs in a folder: SIMULATED or OWN."""
    return SIMULATED if logs == RECORDED else OWN


def machine_note(origin: str) -> str:
    """A table's note on the machines; `origin` is SIMULATED or OWN."""
    return f"The machines differ: {origin}."


class Published(NamedTuple):
    """Mean and standard deviation over five independently synthesised controllers, as printed."""

    mean: float
    deviation: float

    def __str__(self) -> str:
        return f"{self.mean:.2f} ± {self.deviation:.2f}"


def _read(printed: str) -> dict[str, dict[str, Published]]:
    """Rows `name mean ± deviation mean ± deviation ...` as {name: {metric: figure}}."""
    rows = {}
    for line in printed.strip().splitlines():
        name, *numbers = line.replace("±", " ").split()
        figures = map(Published, map(float, numbers[::2]), map(float, numbers[1::2]))
        rows[name] = dict(zip(METRIC_COLUMNS, figures, strict=False))  # the evaluation lacks EEF-PL
    return rows


# <algorithm>_<model kind>, as the folders in artifacts/evaluate_brax are named.
BRAX_EVALUATION = _read(
    """
    ppo_mlp_dq                    644.45 ±  10.31  0.97 ± 0.03  1.00 ± 0.00  0.13 ± 0.01  0.08 ± 0.01  -0.22 ± 0.28
    ppo_mlp_dqdot                 683.36 ±  16.94  0.99 ± 0.01  1.00 ± 0.00  0.15 ± 0.01  0.11 ± 0.01  -0.10 ± 0.08
    ppo_kan_dq                    458.85 ±  17.13  0.91 ± 0.02  0.98 ± 0.01  0.15 ± 0.02  0.10 ± 0.02  -1.17 ± 0.04
    ppo_kan_dqdot                -220.78 ± 604.06  0.26 ± 0.21  0.42 ± 0.35  0.36 ± 0.25  0.24 ± 0.25  -0.71 ± 0.34
    icem_mlp_dqdot                 15.96 ±   5.95  0.20 ± 0.01  0.28 ± 0.01  0.03 ± 0.01  0.02 ± 0.01   0.14 ± 0.01
    icem_dagger_mlp_dqdot        -348.59 ±   1.10  0.66 ± 0.01  0.78 ± 0.00  0.02 ± 0.00  0.01 ± 0.00   0.13 ± 0.02
    icem_double_dagger_mlp_dqdot -148.48 ±   0.31  0.81 ± 0.01  0.91 ± 0.01  0.01 ± 0.00  0.00 ± 0.00   0.14 ± 0.01
    """
)
# Training steps after which the paper evaluates a policy on each model kind.
PPO_EVALUATED_STEPS = {
    "mlp_dq": 270_000_000,
    "mlp_dqdot": 270_000_000,
    "kan_dq": 270_000_000,
    "kan_dqdot": 800_000_000,
}
# iCEM's samples, optimisation steps, entries of a sequence.
ICEM_BUDGET = (500, 12, 20)

# The paper's superscripts for `reward.terms`, in the order of Eq. reward_function.
REWARD_SUPERSCRIPTS = {"pose": "X", "configuration": "q", "precision": "ε", "action": "a", "workspace": "W"}
# PPO on MLP Δq̇, by the superscripts of the summed terms.
REWARD_ABLATION = _read(
    """
    X         -201.65 ±  98.81  0.30 ± 0.33  0.44 ± 0.38  0.22 ± 0.04  0.12 ± 0.03  -0.20 ± 0.12  4.50 ± 1.04
    q          -91.17 ±   0.49  0.97 ± 0.02  1.00 ± 0.00  0.21 ± 0.01  0.16 ± 0.01  -0.16 ± 0.01  2.41 ± 0.04
    X+ε        842.83 ±  20.26  1.00 ± 0.01  1.00 ± 0.00  0.16 ± 0.01  0.12 ± 0.01  -0.24 ± 0.06  2.12 ± 0.04
    q+ε        870.74 ±  10.72  1.00 ± 0.00  1.00 ± 0.00  0.22 ± 0.01  0.17 ± 0.01  -0.19 ± 0.09  2.10 ± 0.02
    X+q       -290.18 ±  68.68  0.59 ± 0.35  0.77 ± 0.21  0.27 ± 0.10  0.20 ± 0.09  -0.30 ± 0.21  3.83 ± 1.37
    X+q+ε      753.17 ±  12.60  1.00 ± 0.00  1.00 ± 0.00  0.18 ± 0.01  0.13 ± 0.01  -0.24 ± 0.06  2.10 ± 0.03
    X+q+ε+a    719.32 ±  14.33  0.99 ± 0.01  1.00 ± 0.00  0.19 ± 0.02  0.14 ± 0.01  -0.24 ± 0.06  2.14 ± 0.03
    X+q+a+W   -356.61 ± 203.17  0.59 ± 0.30  0.78 ± 0.37  0.16 ± 0.04  0.10 ± 0.03  -0.12 ± 0.11  3.97 ± 1.77
    X+q+ε+a+W  683.36 ±  16.94  0.99 ± 0.01  1.00 ± 0.00  0.15 ± 0.01  0.11 ± 0.01  -0.10 ± 0.08  2.15 ± 0.05
    """
)

# Metrics of the tables of deployment, in the paper's order.
DEPLOYMENT_COLUMNS = {
    "sr_002_002": METRIC_COLUMNS["sr_002_002"],
    "sr_012_008": "SR(0.12, 0.08)",
    "oow": METRIC_COLUMNS["oow"],
    "ooz": METRIC_COLUMNS["ooz"],
    "min_z_m": METRIC_COLUMNS["min_z_m"],
}
PAPER_TARGETS = 100


def _read_deployment(printed: str) -> dict[str, dict[str, float]]:
    """Rows `name figure figure ...`, of one controller each, as {name: {metric: figure}}."""
    rows = (line.split() for line in printed.strip().splitlines())
    return {name: dict(zip(DEPLOYMENT_COLUMNS, map(float, figures), strict=True)) for name, *figures in rows}


# Place -> controller -> figures. One seed each; 500 episodes, 100 successive targets.
SIM2SIM = {
    "Brax": _read_deployment(
        """
        ppo_mlp_dq                   0.99 1.00 0.124 0.068 -0.066
        ppo_mlp_dqdot                0.98 1.00 0.130 0.092 -0.103
        ppo_kan_dq                   0.92 1.00 0.136 0.088 -1.184
        icem_double_dagger_mlp_dqdot 0.81 0.98 0.012 0.004  0.124
        """
    ),
    "Gazebo": _read_deployment(
        """
        ppo_mlp_dq                   0.02 0.93 0.124 0.066 -0.004
        ppo_mlp_dqdot                0.11 1.00 0.118 0.068  0.000
        ppo_kan_dq                   0.12 0.90 0.142 0.086 -0.574
        icem_double_dagger_mlp_dqdot 0.74 0.98 0.122 0.068  0.107
        """
    ),
}
SIM2REAL = {
    "Gazebo": _read_deployment(
        """
        ppo_mlp_dq                   0.04 0.94 0.040 0.010 0.091
        ppo_mlp_dqdot                0.08 1.00 0.090 0.020 0.005
        ppo_kan_dq                   0.13 0.87 0.060 0.030 0.000
        icem_double_dagger_mlp_dqdot 0.77 0.98 0.070 0.020 0.151
        """
    ),
    "Machine": _read_deployment(
        """
        ppo_mlp_dq                   0.01 0.43 0.010 0.010 0.154
        ppo_mlp_dqdot                0.02 0.99 0.070 0.040 0.050
        ppo_kan_dq                   0.00 0.69 0.020 0.020 0.099
        icem_double_dagger_mlp_dqdot 0.08 0.71 0.200 0.050 0.120
        """
    ),
}
DEPLOYED = tuple(SIM2SIM["Brax"])  # controllers, in the paper's order

# L(theta) over H = 80 on the evaluation subset, rad^2.
SELECTED_MODELS = {
    "mlp_dq": ("MLP(128, 128)", 18, 8, 1e-3, 512, 5.586e-3),
    "kan_dq": ("KAN(32, 16, 32)", 18, 8, 1e-5, 1024, 5.563e-3),
    "mlp_dqdot": ("MLP(512, 128)", 18, 16, 1e-3, 256, 5.675e-3),
    "kan_dqdot": ("KAN(32, 32, 16)", 18, 16, 1e-4, 512, 5.555e-3),
}
