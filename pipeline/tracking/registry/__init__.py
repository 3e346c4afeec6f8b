"""Models in MLflow's registry: loadable in one line, on a machine that has nothing of this repository."""

MODEL_FOLDER = "model_folder"  # name of the artifact
