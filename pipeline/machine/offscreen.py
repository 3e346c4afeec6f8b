"""An OpenGL context without a display, for MuJoCo's renderer.

MuJoCo's own renderer fixes its OpenGL platform when `mujoco` is imported, long before anyone renders. Here
the platform is chosen on first use: `MUJOCO_GL` if set, else EGL.
"""

import importlib
import os
from typing import Protocol

from pipeline.errors import InputError

_PACKAGES = {"egl": "libegl1 libgl1-mesa-dri", "osmesa": "libosmesa6"}  # Debian's


class RenderingUnavailableError(InputError):
    """This computer cannot render: its OpenGL library is missing or finds no device."""


class GLContext(Protocol):
    """What MuJoCo's contexts offer."""

    def make_current(self) -> None:
        """Makes this thread draw into the context."""

    def free(self) -> None:
        """Releases the context."""


def create_context(width: int, height: int) -> GLContext:
    """Creates an OpenGL context for offscreen pictures.

    Args:
        width: pixels.
        height: pixels.

    Raises:
        InputError: the platform is unknown.
        RenderingUnavailableError: its OpenGL library is missing or finds no device.
    """
    platform = os.environ.get("MUJOCO_GL", "").lower() or "egl"
    if platform not in _PACKAGES:
        raise InputError(
            f"environment variable MUJOCO_GL is {platform!r}; set it to one of {', '.join(_PACKAGES)}"
        )
    try:
        module = importlib.import_module(f"mujoco.{platform}")
        # only now: PyOpenGL fixes its own platform on first import, and MuJoCo's module names the right one
        gl_error = importlib.import_module("OpenGL.error").GLError
    except (ImportError, OSError, AttributeError) as error:  # AttributeError: PyOpenGL found no library
        raise _unavailable(platform, error) from error
    try:
        context: GLContext = module.GLContext(width, height)
    except (ImportError, AttributeError, RuntimeError, gl_error) as error:  # ImportError: no device
        raise _unavailable(platform, error) from error
    return context


def _unavailable(platform: str, error: Exception) -> RenderingUnavailableError:
    return RenderingUnavailableError(
        f"rendering needs the OpenGL platform {platform}, which fails here ({error}); install it (Debian: "
        f"apt install {_PACKAGES[platform]}) or set MUJOCO_GL to {', '.join(set(_PACKAGES) - {platform})}"
    )
