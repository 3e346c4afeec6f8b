"""MuJoCo's MJX, imported without the two lines that it prints where NVIDIA's Warp is not installed.

Brax imports MJX, so whatever imports Brax imports this module before.
"""

import contextlib
import io

with contextlib.redirect_stdout(io.StringIO()):
    import mujoco.mjx  # noqa: F401
