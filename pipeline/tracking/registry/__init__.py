"""Models in MLflow's registry: loadable in one line on a computer without this repository."""

MODEL_FOLDER = "model_folder"  # name of the artifact
