"""Draft a machine's configuration from what its logs hold; `???` stands where only the user knows."""

import json
import math
import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field

from pipeline.logs.describe.can import CAN_FRAME
from pipeline.logs.describe.contents import Contents, FieldContents, Stream
from pipeline.logs.describe.field_types import TEXT, TIME
from pipeline.logs.describe.lerobot import DATASET
from pipeline.logs.describe.tables import TABLE, time_column
from pipeline.logs.messages.joint_states import FOXGLOVE_TYPE

UNKNOWN = '"???"'  # quoted, as YAML takes no bare question mark within braces
DEFAULT_RATE_HZ = 20.0
ROUND_RATES_HZ = (1.0, 2.0, 5.0, 10.0, DEFAULT_RATE_HZ)
COMMAND_NAME = re.compile(
    r"(^|[^a-z])((cmd|command|joy|control|action|target|desired|goal|setpoint|input|volt)|(u|a|tau|ref)([^a-z]|$))",
    re.IGNORECASE,
)
STATE_NAME = re.compile(
    r"state|position|encoder|angle|joint|measured|feedback|(^|[^a-z])(q|pos)([^a-z]|$)", re.IGNORECASE
)
MAXIMUM_WORDS = 16  # of a column's name
MAXIMUM_TEMPLATES = 200  # those of most joints; every pair of them is looked at
PLAIN = re.compile(r"[A-Za-z/][\w/]*")
BY_POSITION = "the values of commands follow this order: put the joints into the order of the values"
BY_NAME = "commands are matched by name, so any order will do"
FIELDS_OF_JOINTS = ("velocity", "effort", "position")


@dataclass
class Draft:
    """A guess of what the machine's file must say.

    Attributes:
        joints: Names, each with the field and the element of its position, where they are known.
        positions: Lines for joint states, or for the columns of a table.
        commands: Lines for commands.
        order: How commands are matched to joints.
        command_fields: What holds the commands, by which their kind is guessed.
        rate_hz: Of the joint samples.
    """

    joints: list[tuple[str, FieldContents | None, int]] = field(default_factory=list)
    positions: list[str] = field(default_factory=list)
    commands: list[str] = field(default_factory=list)
    order: str = BY_POSITION
    command_fields: list[FieldContents] = field(default_factory=list)
    rate_hz: float = 0.0


def draft_machine(contents: Contents, name: str) -> str:
    """Return the text of `conf/machine/<name>.yaml`.

    Args:
        contents: What the logs hold.
        name: The machine's name; empty where it is not known yet.
    """
    return "\n".join(_lines(_drafted(contents), name)) + "\n"


def order_of_joints(contents: Contents) -> str:
    """Return a line that says in which order the draft lists the joints, and what commands have to do with it."""
    draft = _drafted(contents)
    return f"joints: {', '.join(name for name, *_ in draft.joints) or UNKNOWN}; {draft.order}"


def _drafted(contents: Contents) -> Draft:
    streams = list(contents.streams.values())
    of_type: dict[str, list[Stream]] = {}
    for stream in streams:
        of_type.setdefault(stream.type_name, []).append(stream)
    others = {TABLE: "columns", CAN_FRAME: "can", DATASET: "lerobot"}
    topics = [stream for stream in streams if stream.type_name not in others]
    if topics or not streams:
        return _of_topics(topics)
    if TABLE in of_type:
        return _of_table(max(of_type[TABLE], key=lambda stream: stream.n_messages))
    kind = next(kind for kind in others if kind in of_type)
    return _of_signals(of_type[kind], others[kind])


def _lines(draft: Draft, name: str) -> Iterator[str]:
    yield "# Drafted from logs: replace every ???, check the rest, and set the machine's own limits."
    yield f"name: {_quoted(name) if name else UNKNOWN}  # the file's name without .yaml"
    rate = min(ROUND_RATES_HZ, key=lambda one: abs(math.log(one / (draft.rate_hz or DEFAULT_RATE_HZ))))
    seen = f"come at {draft.rate_hz:.4g} Hz" if draft.rate_hz else "come at a rate that could not be measured"
    yield f"# Joint samples {seen}. Rows are interpolated to the rate that stands here."
    yield f"rate_hz: {rate:g}  # a guess: set the rate at which the machine is controlled, a round figure"
    yield from _command_kind(draft.command_fields)
    yield f"# Order: {draft.order}."
    yield "# Each kind is a guess: check it. revolute: limits in rad; prismatic (the joint slides): limits in m."
    yield "joints:"
    for joint, content, element in draft.joints or [(UNKNOWN, None, 0)]:
        seen = ""
        if content is not None and element < content.n_elements:
            seen = (
                f"  # seen {content.low[element]:.4g} to {content.high[element]:.4g} {content.unit}".rstrip()
            )
        kind = "prismatic" if content is not None and content.unit == "m" else "revolute"
        yield f"  - {{name: {_quoted(joint)}, kind: {kind}, lower: {UNKNOWN}, upper: {UNKNOWN}}}{seen}"
    yield from draft.positions
    yield from draft.commands


def _command_kind(fields: list[FieldContents]) -> Iterator[str]:
    known = [content for content in fields if content.n_elements]
    low = min((float(content.low.min()) for content in known), default=0.0)
    high = max((float(content.high.max()) for content in known), default=0.0)
    seen = f"commands seen: {low:.4g} to {high:.4g}" if known else "no commands seen"
    is_discrete = bool(known) and all(content.is_whole for content in known) and low >= -1 and high <= 1
    kind = "discrete" if is_discrete else "continuous"
    yield f"command_kind: {kind}  # discrete: -1, 0, 1; continuous: [-1, 1]; {seen}"


def _of_topics(streams: list[Stream]) -> Draft:
    draft = Draft()
    states = max(streams, key=_is_state, default=None)
    if states is None or _is_state(states) <= 0:
        states = None
    if states is not None:
        _take_states(states, draft)
    else:
        draft.positions = _topic_lines("joint_states", UNKNOWN, f"field_paths: [{UNKNOWN}]", [])
    others = [stream for stream in streams if stream is not states and stream.n_messages]
    commands = max(others, key=lambda stream: _is_command(stream, len(draft.joints)), default=None)
    if commands is not None and _is_command(commands, len(draft.joints)) > 0:
        _take_commands(commands, draft)
    else:
        draft.commands = _topic_lines("commands", UNKNOWN, f"source: {UNKNOWN}", [])
    return draft


def _take_states(stream: Stream, draft: Draft) -> None:
    draft.rate_hz = stream.rate_hz
    if names := _joint_names(stream):
        position = stream.fields["joints[].position" if stream.type_name == FOXGLOVE_TYPE else "position"]
        draft.joints = [(name, position, number) for number, name in enumerate(names)]
        draft.positions = [f"joint_states: {{topic: {_quoted(stream.name)}}}  # {stream.type_name}"]
        return
    paths = list(_numbers(stream))
    draft.joints = [(f"joint_{i + 1}", content, element) for i, (_, content, element) in enumerate(paths)]
    listed = ", ".join(_quoted(path) for path, *_ in paths)
    draft.positions = _topic_lines(
        "joint_states", stream.name, f"field_paths: [{listed}]", [f"# {stream.type_name}: one path per joint"]
    )


def _take_commands(stream: Stream, draft: Draft) -> None:
    n_joint, kind = len(draft.joints), f"# {stream.type_name}"
    data, axes = stream.fields.get("data"), stream.fields.get("axes")
    if stream.type_name.endswith("MultiArray") and data is not None and 0 < data.n_elements <= n_joint:
        draft.command_fields = [data]
        of = f"{data.n_elements} values: leave only their joints above, in their order"
        lines = [
            f"source: array  # {of if data.n_elements < n_joint else 'one value per joint, in their order'}"
        ]
    elif _joint_names(stream) and stream.type_name != FOXGLOVE_TYPE:
        field_name = next((n for n in FIELDS_OF_JOINTS if stream.fields[n].n_elements), "velocity")
        draft.command_fields = [stream.fields[field_name]]
        lines = ["source: joint_state", f"field_name: {field_name}"]
        draft.order = BY_NAME
    elif stream.type_name.endswith("/Joy") and axes is not None:
        draft.command_fields = [axes]
        listed = ", ".join(map(str, range(n_joint)))
        signs = ", ".join(["1"] * n_joint)
        lines = [
            "source: joy",
            f"axes: [{listed}]  # of {axes.n_elements}: one per joint",
            f"signs: [{signs}]",
        ]
        lines += ["threshold: 0.5  # of discrete commands"]
    else:
        paths = list(_numbers(stream))
        draft.command_fields = [content for _, content, _ in paths[:n_joint]]
        listed = ", ".join(_quoted(path) for path, *_ in paths[:n_joint])
        missing = f", {UNKNOWN}" * max(n_joint - len(paths), 0)
        lines = ["source: field_path", f"field_paths: [{listed}{missing}]"]
        if len(paths) != n_joint:
            lines += [f"# one path per joint, of: {', '.join(path for path, *_ in paths)}"]
    draft.commands = _topic_lines("commands", stream.name, lines[0], [*lines[1:], kind])


def _of_table(stream: Stream) -> Draft:
    draft = Draft(rate_hz=stream.rate_hz, order=BY_NAME)
    time = time_column(stream)
    names = [name for name, c in stream.fields.items() if name != time and c.type_name not in (TEXT, TIME)]
    position, command, joints = _templates(names)
    draft.joints = [(joint, stream.fields[position.replace("{joint}", joint)], 0) for joint in joints]
    if not joints:
        draft.joints = [(UNKNOWN, None, 0)]
    if command != UNKNOWN:
        draft.command_fields = [stream.fields[command.replace("{joint}", joint)] for joint in joints]
    unit = (stream.fields[time].unit if time is not None else "") or "s"
    is_text = time is not None and stream.fields[time].type_name == TEXT
    unread = "  # holds text, and dates in text are not read: save times as numbers" if is_text else ""
    draft.positions = [
        "columns:  # {joint} stands for the joint's name",
        f"  time: {_quoted(time) if time is not None else UNKNOWN}{unread}",
        f"  time_unit: {unit}",
        f"  position: {_quoted(position)}",
        f"  command: {_quoted(command)}",
        f"# columns: {', '.join(stream.fields)}",
    ]
    return draft


def _of_signals(streams: list[Stream], section: str) -> Draft:
    """CAN frames by `FRAME.SIGNAL`, or LeRobot features by their path."""
    signals = {
        f"{stream.name}.{name}" if section == "can" else name: (content, stream)
        for stream in streams
        for name, content in stream.fields.items()
    }
    position, command, joints = _templates(
        [path for path, (content, _) in signals.items() if content.n_elements]
    )
    draft = Draft(
        [(joint, signals[position.replace("{joint}", joint)][0], 0) for joint in joints], order=BY_NAME
    )
    draft.joints = draft.joints or [(UNKNOWN, None, 0)]
    if joints:
        draft.command_fields = [signals[command.replace("{joint}", joint)][0] for joint in joints]
        draft.rate_hz = signals[position.replace("{joint}", joints[0])][1].rate_hz
    else:
        draft.rate_hz = max((stream.rate_hz for stream in streams), default=0.0)
    database = ["  database: ???  # the DBC file, beside this file"] if section == "can" else []
    draft.positions = [
        f"{section}:  # one per joint, or one with {{joint}} for all",
        *database,
        f"  positions: [{_quoted(position)}]",
        f"  commands: [{_quoted(command)}]",
        f"# there are: {', '.join(signals) or 'no signals without a DBC file'}",
    ]
    return draft


def _templates(names: list[str]) -> tuple[str, str, list[str]]:
    """The columns of positions and of commands as templates, and the joints; `UNKNOWN` where none is likely."""
    joints: dict[str, list[str]] = {}
    for name in names:
        parts = re.split(r"([_./ -]|(?<=[a-z])(?=\d))", name)
        if len(parts) > 2 * MAXIMUM_WORDS:
            continue
        for begin in range(0, len(parts), 2):
            for end in range(begin + 1, len(parts) + 1, 2):
                template = "".join([*parts[:begin], "{joint}", *parts[end:]])
                if template != "{joint}":
                    joints.setdefault(template, []).append("".join(parts[begin:end]))

    # How much a template's name is one of positions, and less one of commands.
    of_state = {one: bool(STATE_NAME.search(one)) - bool(COMMAND_NAME.search(one)) for one in joints}
    largest = set(sorted(joints, key=lambda one: -len(joints[one]))[:MAXIMUM_TEMPLATES])
    own = {one: set(joints[one]) for one in joints if one in largest}
    pairs = [(p, c) for p in own for c in own if of_state[p] > of_state[c] and own[p] & own[c]]
    if not pairs:
        return UNKNOWN, UNKNOWN, []
    position, command = max(
        pairs, key=lambda pair: (len(own[pair[0]] & own[pair[1]]), of_state[pair[0]] - of_state[pair[1]])
    )
    return position, command, [joint for joint in joints[position] if joint in own[command]]


def _numbers(stream: Stream) -> Iterator[tuple[str, FieldContents, int]]:
    """The stream's numbers, each with its path, but those of headers."""
    for path, content in stream.fields.items():
        if content.type_name in (TIME, TEXT) or path.startswith(("header.", "layout.")):
            continue
        is_list = "[" in content.type_name
        for element in range(content.n_elements):
            yield (f"{path}[{element}]" if is_list else path), content, element


def _joint_names(stream: Stream) -> Collection[str]:
    """The joints that joint states name; empty for other messages."""
    return stream.names if stream.type_name.endswith(("JointState", "JointStates")) else ()


def _is_state(stream: Stream) -> float:
    """How likely a stream holds the joint states; zero or less: it does not."""
    score = 4.0 * bool(_joint_names(stream)) + 2.0 * bool(STATE_NAME.search(stream.name))
    score -= 3.0 * bool(COMMAND_NAME.search(stream.name))
    has_numbers = any(c.n_elements for path, c in stream.fields.items() if not path.startswith("header"))
    return score + min(stream.n_messages, 10**6) * 1e-7 if has_numbers and score > 0 else 0.0


def _is_command(stream: Stream, n_joint: int) -> float:
    """How likely a stream holds the commands; zero or less: it does not."""
    n_numbers = sum(1 for _ in _numbers(stream))
    if not n_numbers:
        return 0.0
    score = 4.0 * bool(COMMAND_NAME.search(stream.name)) + 2.0 * stream.type_name.endswith(
        ("MultiArray", "/Joy")
    )
    score += 1.0 * (n_numbers == n_joint) + 1.0 * stream.type_name.endswith(("Twist", "TwistStamped"))
    return score - 2.0 * bool(STATE_NAME.search(stream.name)) * (score < 4.0)


def _topic_lines(section: str, topic: str, first: str, others: list[str]) -> list[str]:
    return [f"{section}:", f"  topic: {_quoted(topic)}", f"  {first}", *(f"  {line}" for line in others)]


def _quoted(text: str) -> str:
    """A text as YAML takes it."""
    return text if text == UNKNOWN or PLAIN.fullmatch(text) else json.dumps(text, ensure_ascii=False)
