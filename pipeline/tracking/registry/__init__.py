"""Models in MLflow's registry: loadable in one line on a computer without this repository."""
