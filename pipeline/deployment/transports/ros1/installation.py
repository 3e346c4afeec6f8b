"""Debian's ROS 1 beside this environment."""

import importlib
import sys
from pathlib import Path
from types import ModuleType

from pipeline.errors import InputError

DEBIAN_PACKAGES = Path("/usr/lib/python3/dist-packages")
ROSMASTER = Path("/usr/bin/rosmaster")
REMEDY = "apt-get install --no-install-recommends python3-rospy python3-rosmaster python3-actionlib python3-sensor-msgs"


def require_ros() -> ModuleType:
    """The module `rospy`.

    Debian's packages come last on the path, so that they supply only what this environment lacks.

    Raises:
        InputError: ROS 1 is not installed.
    """
    if str(DEBIAN_PACKAGES) not in sys.path:
        sys.path.append(str(DEBIAN_PACKAGES))
    try:
        if not ROSMASTER.exists():
            raise ImportError(str(ROSMASTER))
        for name in ("actionlib", "sensor_msgs.msg", "std_msgs.msg", "geometry_msgs.msg"):
            importlib.import_module(name)
        return importlib.import_module("rospy")
    except ImportError as error:
        raise InputError(f"ROS 1 is not installed ({error}); {REMEDY}") from None
