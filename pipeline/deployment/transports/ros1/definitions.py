"""Our own ROS types, built at the start of a process without ROS 1's message compiler.

Their definitions are those of the ROS package `hydraulic_arm` beside this file (`msg`, `action`). An action is a
definition of goal, result and feedback, from which seven message types follow (actionlib); Debian's packages provide
the standard types in them. Those of `diagnostic_msgs` are read from rosbags, as no package that we need installs them.
"""

from collections.abc import Mapping
from functools import cache
from pathlib import Path

from rosbags.typesys import Stores, get_typestore

from pipeline.deployment.transports.ros1.installation import require_ros

PACKAGE_FOLDER = Path(__file__).parent / "hydraulic_arm"
PACKAGE = PACKAGE_FOLDER.name
SEPARATOR = "\n" + "=" * 80 + "\n"  # between the definitions of one full text
PARTS = "---"  # between goal, result and feedback
CAN_FRAME = (  # can_msgs/Frame, as the drivers of ros_canopen have it; Debian does not package it
    "Header header\nuint32 id\nbool is_rtr\nbool is_extended\nbool is_error\nuint8 dlc\nuint8[8] data\n"
)


@cache
def own_types() -> dict[str, type]:
    """ROS types by name: messages of the package, the types of its actions, and `can_msgs/Frame`.

    Raises:
        InputError: ROS 1 is not installed.
    """
    require_ros()
    definitions = {"can_msgs/Frame": CAN_FRAME, **_diagnostic_definitions()}
    for path in sorted(PACKAGE_FOLDER.glob("msg/*.msg")):
        definitions[f"{PACKAGE}/{path.stem}"] = path.read_text()
    for path in sorted(PACKAGE_FOLDER.glob("action/*.action")):
        definitions |= action_messages(f"{PACKAGE}/{path.stem}", path.read_text())
    return generate(definitions)


def action_messages(name: str, text: str) -> dict[str, str]:
    """Definitions of the seven message types of an action, as actionlib's own generator makes them.

    Args:
        name: `package/Action`, without the ending `Action`.
        text: content of the `.action` file.
    """
    goal, result, feedback = (part.strip() + "\n" for part in text.split(PARTS))
    base = name.split("/")[1]
    return {
        f"{name}Goal": goal,
        f"{name}Result": result,
        f"{name}Feedback": feedback,
        f"{name}ActionGoal": f"Header header\nactionlib_msgs/GoalID goal_id\n{base}Goal goal\n",
        f"{name}ActionResult": f"Header header\nactionlib_msgs/GoalStatus status\n{base}Result result\n",
        f"{name}ActionFeedback": f"Header header\nactionlib_msgs/GoalStatus status\n{base}Feedback feedback\n",
        f"{name}Action": (
            f"{base}ActionGoal action_goal\n{base}ActionResult action_result\n"
            f"{base}ActionFeedback action_feedback\n"
        ),
    }


def generate(definitions: Mapping[str, str]) -> dict[str, type]:
    """Generate classes of types that may use each other and the standard ones.

    Args:
        definitions: text by name.
    """
    from genpy.dynamic import generate_dynamic

    first, *others = {**definitions, **_standard_definitions()}.items()
    sections = [first[1], *(f"MSG: {name}\n{text}" for name, text in others)]
    generated = generate_dynamic(first[0], SEPARATOR.join(sections))
    return {name: generated[name] for name in definitions}


def _diagnostic_definitions() -> dict[str, str]:
    array = "diagnostic_msgs/msg/DiagnosticArray"
    text, _ = get_typestore(Stores.ROS1_NOETIC).generate_msgdef(array, ros_version=1)
    first, *others = text.split(SEPARATOR)
    sections = dict(section.removeprefix("MSG: ").split("\n", 1) for section in others)
    sections = {name: text for name, text in sections.items() if name.startswith("diagnostic_msgs/")}
    return {array.replace("/msg", ""): first, **sections}


@cache
def _standard_definitions() -> dict[str, str]:
    """Definitions of the standard types that ours use, from the classes that Debian ships."""
    from actionlib_msgs.msg import GoalStatus
    from geometry_msgs.msg import PoseStamped

    definitions = {"actionlib_msgs/GoalStatus": GoalStatus._full_text.split(SEPARATOR)[0]}
    for ros_type in (GoalStatus, PoseStamped):
        for section in ros_type._full_text.split(SEPARATOR)[1:]:
            header, text = section.split("\n", 1)
            definitions[header.removeprefix("MSG: ")] = text
    definitions["geometry_msgs/PoseStamped"] = PoseStamped._full_text.split(SEPARATOR)[0]
    return definitions
