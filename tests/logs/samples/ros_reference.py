"""What ROS's own Python library reads from bags; run by Debian's Python: `ros_reference.py OUT.pickle BAG...`.

The pickle holds for each bag and topic the messages, as tuples of plain numbers, in the order of
`rosbag.Bag.read_messages`, and the connections that they came by.
"""

import pickle
import sys

import rosbag


def values(message):
    kind = message._type
    if kind == "sensor_msgs/JointState":
        stamp = message.header.stamp
        return stamp.secs, stamp.nsecs, message.header.seq, tuple(message.name), tuple(message.position)
    if kind == "sensor_msgs/Joy":
        return tuple(message.axes)
    if kind == "geometry_msgs/PoseStamped":
        position, turn = message.pose.position, message.pose.orientation
        xyz, wxyz = (position.x, position.y, position.z), (turn.w, turn.x, turn.y, turn.z)
        return message.header.frame_id, xyz, wxyz
    return tuple(message.data) if kind == "std_msgs/Int8MultiArray" else ()


def contents(path):
    topics = {}
    with rosbag.Bag(path) as bag:
        for topic, message, time, header in bag.read_messages(return_connection_header=True):
            found = topics.setdefault(topic, {"messages": [], "callers": set(), "latching": set()})
            found["messages"].append((time.to_nsec(), values(message)))
            found["callers"].add(header.get("callerid", b"").decode())
            found["latching"].add(header.get("latching", b"").decode())
        compression = bag.get_compression_info().compression
    return {"topics": topics, "compression": compression}


if __name__ == "__main__":
    with open(sys.argv[1], "wb") as file:
        pickle.dump({path: contents(path) for path in sys.argv[2:]}, file)
