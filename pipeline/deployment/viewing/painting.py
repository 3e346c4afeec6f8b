"""What an operator paints of W+, as topics: where the tip has been, how much that is, where to go next."""

import numpy as np

from pipeline.deployment.component import nanoseconds
from pipeline.deployment.transports.mcap_file import RecordedTopic
from pipeline.deployment.viewing.coverage import Coverage, ReachableCells
from pipeline.deployment.viewing.ros_messages import cloud, number_message, text_message
from pipeline.deployment.viewing.visual_topics import pose_mark
from pipeline.logs.messages.columns import as_array
from pipeline.logs.messages.raw_log import RawLog

PAINTED_TOPICS = {
    "/painted": "sensor_msgs/msg/PointCloud2",
    "/painted_share": "std_msgs/msg/Float64",
    "/painting": "std_msgs/msg/String",
    "/paint_next": "sensor_msgs/msg/PointCloud2",
}
PERIOD_NS = nanoseconds(1.0)  # each message holds the whole history
MESSAGES_PER_LOG = 100  # so that a file grows with the log's length, and not with its square
POINT_SPACING = 0.02  # m, rad: points of half a chisel's diameter make a line
MOST_POINTS = (
    50_000  # more than an hour's; a shift's would take a viewer longer than the second between messages
)
NEXT = 3  # poses at a time: more hide each other
COLOURS = np.array(
    [[86, 180, 233], [255, 255, 255], [213, 94, 0]]
)  # of Okabe and Ito, from inwards to outwards


class Painting:
    """The history of the tip, and its coverage of W+."""

    def __init__(self, reachable: ReachableCells) -> None:
        """Nothing is painted yet."""
        self._reachable, self._coverage = reachable, Coverage(reachable)
        self._history: list[np.ndarray] = []  # x, y, z, pitch
        self._newest = np.zeros(0)

    def add(self, q: np.ndarray) -> None:
        """Paint with configurations (N, n_joint), rad (m), in the order of time."""
        arm = self._reachable.arm
        self._coverage.add(q)
        for pose in np.column_stack([arm.forward(q).position, arm.pitch(q)]):
            if not self._history or np.abs(pose - self._history[-1]).max() >= POINT_SPACING:
                self._history.append(pose)
        while len(self._history) > MOST_POINTS:
            del self._history[::2]
        self._newest = q[-1]

    def topics(self, time_ns: int) -> list[RecordedTopic]:
        """One message of each topic, once something is painted."""
        arm, history = self._reachable.arm, np.array(self._history)
        ahead = self._coverage.nearest(self._newest, NEXT)
        poses = arm.forward(ahead)
        marks = [pose_mark(p, w) for p, w in zip(poses.position, poses.quaternion, strict=True)]
        pitch = history[:, 3]
        colours = pitch_colours(pitch, self._reachable.config.pitch_max_rad)
        contents = {
            "/painted": cloud(history[:, :3], time_ns, {"pitch": pitch, **colours}),
            "/painted_share": number_message(self._coverage.share),
            "/painting": text_message(self._text(ahead, poses.position)),
            "/paint_next": cloud(np.concatenate([np.zeros((0, 3)), *marks]), time_ns),
        }
        return [RecordedTopic(name, PAINTED_TOPICS[name], [(time_ns, m)]) for name, m in contents.items()]

    def _text(self, ahead: np.ndarray, position: np.ndarray) -> str:
        coverage, config, arm = self._coverage, self._reachable.config, self._reachable.arm
        lines = [
            f"painted {100 * coverage.share:.1f} % of what can be reached of W+: {coverage.n_visited} of "
            f"{coverage.n_reachable} cells of {config.cell_m:g} m and {config.pitch_bin_rad:g} rad"
        ]
        for (x, y, z), yaw, pitch in zip(position, arm.yaw(ahead), arm.pitch(ahead), strict=True):
            lines.append(
                f"next: {np.hypot(x, y):.2f} m out, {z:.2f} m up, yaw {yaw:+.2f} rad, pitch {pitch:+.2f} rad"
            )
        return "\n".join(lines)


def painted_topics(log: RawLog, reachable: ReachableCells) -> list[RecordedTopic]:
    """The topics over a log with joint states, with a message a second, or a hundred messages of a longer log."""
    time_ns, q = as_array(log.joint_log_time_ns), as_array(log.q)
    period_ns = max(PERIOD_NS, int(time_ns[-1] - time_ns[0]) // MESSAGES_PER_LOG)
    ends = np.flatnonzero(np.diff((time_ns - time_ns[0]) // period_ns, append=-1))
    painting = Painting(reachable)
    topics = [RecordedTopic(name, type_name, []) for name, type_name in PAINTED_TOPICS.items()]
    begin = 0
    for last in ends.tolist():
        painting.add(q[begin : last + 1])
        begin = last + 1
        for topic, now in zip(topics, painting.topics(int(time_ns[last])), strict=True):
            topic.messages.extend(now.messages)
    return topics


def pitch_colours(pitch: np.ndarray, pitch_max_rad: float) -> dict[str, np.ndarray]:
    """Colours of pitches (n,), rad, as fields of a cloud, uint32.

    Returns:
        `rgb` is 0x00RRGGBB, which Foxglove draws; `colors` is 0xRRGGBBAA, which Rerun draws.
    """
    at = [-pitch_max_rad, 0.0, pitch_max_rad]
    red, green, blue = (np.rint(np.interp(pitch, at, channel)).astype(np.uint32) for channel in COLOURS.T)
    rgb = red << 16 | green << 8 | blue
    return {"rgb": rgb, "colors": rgb << 8 | 0xFF}
