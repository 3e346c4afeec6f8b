"""What a stage's `--help` prints: what the stage does, its own keys, and where all others stand."""

import re
from pathlib import Path

DEFAULTS = re.compile(r"^defaults:\n(  .*\n)+\n*", re.MULTILINE)  # of Hydra: how the whole is composed
GROUPS = ("machine", "profile", "tracking")


def help_text(stage: str, does: str, configuration: Path) -> str:
    """Help for whoever types a stage's command.

    Hydra's own has every value of the profile, some 700 lines, and no comments.

    Args:
        stage: Its name, which is also that of its file in the configuration's folder.
        does: What it does: the docstring of its module.
        configuration: The folder `conf`.
    """
    keys = DEFAULTS.sub("", (configuration / f"{stage}.yaml").read_text(encoding="utf-8"))
    choices = "\n".join(
        f"{group}={'|'.join(sorted(path.stem for path in (configuration / group).glob('*.yaml')))}"
        for group in GROUPS
    )
    return f"""{does.strip()}

python -m pipeline.stages.{stage} KEY=VALUE ...

Its keys, with their defaults; those with ??? must be given:

{keys.strip()}

{choices}

conf/profile/paper.yaml explains all other parameters. --cfg job prints their values, -m sweeps over any.
"""
