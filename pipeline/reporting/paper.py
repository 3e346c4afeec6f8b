"""The paper's published figures, to stand beside ours.

Tables "Evaluation results obtained in the Brax-based training environment" and "Selected parameterizations and
training hyperparameters for the dynamic models".
"""

KIND_NAMES = {"mlp_dq": "MLP Δq", "mlp_dqdot": "MLP Δq̇", "kan_dq": "KAN Δq", "kan_dqdot": "KAN Δq̇"}

# Mean ± standard deviation over five controllers, 500 episodes each.
BRAX_EVALUATION_COLUMNS = ("Avg. return", "SR(0.02, 0.02)", "SR(0.04, 0.04)", "OOW", "OOZ", "Min. z [m]")
PPO_BRAX_EVALUATION = {
    "mlp_dq": ("644.45 ± 10.31", "0.97 ± 0.03", "1.00 ± 0.00", "0.13 ± 0.01", "0.08 ± 0.01", "-0.22 ± 0.28"),
    "mlp_dqdot": (
        "683.36 ± 16.94",
        "0.99 ± 0.01",
        "1.00 ± 0.00",
        "0.15 ± 0.01",
        "0.11 ± 0.01",
        "-0.10 ± 0.08",
    ),
    "kan_dq": ("458.85 ± 17.13", "0.91 ± 0.02", "0.98 ± 0.01", "0.15 ± 0.02", "0.10 ± 0.02", "-1.17 ± 0.04"),
    "kan_dqdot": (
        "-220.78 ± 604.06",
        "0.26 ± 0.21",
        "0.42 ± 0.35",
        "0.36 ± 0.25",
        "0.24 ± 0.25",
        "-0.71 ± 0.34",
    ),
}

# L(theta) over H = 80 on the evaluation subset, rad^2.
SELECTED_MODELS = {
    "mlp_dq": ("MLP(128, 128)", 18, 8, 1e-3, 512, 5.586e-3),
    "kan_dq": ("KAN(32, 16, 32)", 18, 8, 1e-5, 1024, 5.563e-3),
    "mlp_dqdot": ("MLP(512, 128)", 18, 16, 1e-3, 256, 5.675e-3),
    "kan_dqdot": ("KAN(32, 32, 16)", 18, 16, 1e-4, 512, 5.555e-3),
}
