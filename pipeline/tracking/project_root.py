"""The project that a command belongs to, which keeps its runs."""

from pathlib import Path

import pipeline

CODE = Path(pipeline.__file__).resolve().parents[1]  # the repository that this code is from
QUEUED = (".dvc", "tmp", "exps")  # where DVC runs queued experiments, in copies that it deletes


def project_folder(start: Path | None = None) -> Path:
    """The DVC project around the folder `start` (the present one by default), else the repository of this code.

    Runs are thus stored neither in the current folder nor in the temporary copy in which DVC runs a queued experiment.
    """
    folder = (start or Path.cwd()).resolve()
    for depth in range(len(folder.parts) - len(QUEUED) + 1):
        if folder.parts[depth : depth + len(QUEUED)] == QUEUED:
            return Path(*folder.parts[:depth])
    return next((place for place in (folder, *folder.parents) if (place / ".dvc").is_dir()), CODE)
