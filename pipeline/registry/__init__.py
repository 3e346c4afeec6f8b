"""Models in MLflow's registry: loadable in one line, on a machine that has nothing of this repository."""
