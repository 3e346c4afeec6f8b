"""The robot description (URDF) as MuJoCo reads it, for shapes and pictures."""

from pathlib import Path

import mujoco

from pipeline.errors import InputError


def read_urdf(path: Path) -> mujoco.MjSpec:
    """The URDF as MuJoCo's editable specification.

    Raises:
        InputError: the file is not a URDF that MuJoCo can read.
    """
    try:
        return mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise InputError(f"{path}: not a readable URDF: {error}") from error


def compile_urdf(specification: mujoco.MjSpec, path: Path) -> mujoco.MjModel:
    """MuJoCo's model of a specification that was read from `path`.

    Raises:
        InputError: MuJoCo refuses it, such as for a negative mass.
    """
    try:
        return specification.compile()
    except ValueError as error:
        raise InputError(f"{path}: not a valid robot description: {error}") from error
