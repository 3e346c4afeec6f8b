"""ROS nodes whose topics the recorder's tests record; run by Debian's Python: `ros_publishers.py arm|second`.

Values are drawn so that no two messages are alike, with the floats among them that a careless reader changes.
"""

import contextlib
import os
import random
import struct
import sys

import rospy
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Int8MultiArray, MultiArrayDimension, UInt8MultiArray

TICK_HZ = 100
TICKS_PER_SAMPLE, TICKS_PER_COMMAND, TICKS_PER_BULK, TICKS_PER_TARGET = 2, 5, 10, 130
BULK_BYTES = 100_000  # fills the compressors' blocks, which are up to 1 MB, within a second
SAMPLE_AGE_S = 0.0015  # of an encoder's sample when its message is sent
QUEUE = 1000
SMALLEST = 5e-324
ODD_FLOATS = (-0.0, SMALLEST, float("nan"), float("-inf"), 1e308)
STICK_DEFLECTIONS = (-1.0, -0.5, -0.25, -0.0, 0.0, 0.25, 0.5, 1.0)  # the tests' threshold is among them
NEXT_AFTER_HALF = struct.unpack("<f", struct.pack("<I", 0x3F000001))[0]  # the next float32
NAMES = {
    "arm": ["arm", "pump", "swing", "bucket", "boom"],
    "second": ["boom", "bucket", "arm", "swing"],
}


class Publishers:
    """One node's publishers, driven by ticks."""

    def __init__(self, kind):
        self.random = random.Random(kind)
        self.names = NAMES[kind]
        self.is_arm = kind == "arm"
        self.shared_states = self.publisher("/shared/joint_states", JointState)
        self.shared_commands = self.publisher("/shared/joint_commands", Int8MultiArray)
        if self.is_arm:
            self.states = self.publisher("/joint_states", JointState)
            self.commands = self.publisher("/joint_commands", Int8MultiArray)
            self.joy = self.publisher("/joy", Joy)
            self.bulk = self.publisher("/bulk", UInt8MultiArray)
            self.target = self.publisher("/target_pose", PoseStamped, latch=True)

    def publisher(self, topic, kind, latch=False):
        return rospy.Publisher(topic, kind, queue_size=QUEUE, latch=latch)

    def tick(self, number):
        if number % TICKS_PER_SAMPLE == 0:
            self.shared_states.publish(self.joint_state())
            if self.is_arm:
                self.states.publish(self.joint_state())
        if number % TICKS_PER_COMMAND == 0:
            self.shared_commands.publish(self.command())
            if self.is_arm:
                self.commands.publish(self.command())
                self.joy.publish(self.sticks())
        if number % TICKS_PER_BULK == 0 and self.is_arm and self.bulk.get_num_connections():
            self.bulk.publish(UInt8MultiArray(data=os.urandom(BULK_BYTES)))
        if number % TICKS_PER_TARGET == 0 and self.is_arm:
            self.target.publish(self.pose())

    def joint_state(self):
        message = JointState(name=self.names)
        message.header.stamp = rospy.Time.now() - rospy.Duration(SAMPLE_AGE_S)
        message.position = [self.random.gauss(0, 1) for _ in self.names]
        if self.random.random() < 0.2:
            message.position[self.random.randrange(len(self.names))] = self.random.choice(ODD_FLOATS)
        if self.is_arm:
            message.effort = [self.random.gauss(0, 1) for _ in self.names]
        return message

    def command(self):
        message = Int8MultiArray(data=[self.random.choice((-1, 0, 1)) for _ in range(4)])
        message.layout.dim = [MultiArrayDimension("joints", 4, 4)]
        return message

    def sticks(self):
        message = Joy(buttons=[self.random.choice((0, 1)) for _ in range(3)])
        message.header.stamp = rospy.Time.now()
        choices = (*STICK_DEFLECTIONS, NEXT_AFTER_HALF, self.random.uniform(-1, 1))
        message.axes = [self.random.choice(choices) for _ in range(6)]
        return message

    def pose(self):
        message = PoseStamped()
        message.header.stamp = rospy.Time.now()
        message.header.frame_id = "base"
        for vector in (message.pose.position, message.pose.orientation):
            for axis in vector.__slots__:
                setattr(vector, axis, self.random.gauss(0, 1))
        return message


def main():
    kind = sys.argv[1]
    rospy.init_node(kind)
    publishers = Publishers(kind)
    rate = rospy.Rate(TICK_HZ)
    number = 0
    while not rospy.is_shutdown():
        publishers.tick(number)
        number += 1
        rate.sleep()


if __name__ == "__main__":
    with contextlib.suppress(rospy.ROSInterruptException):
        main()
