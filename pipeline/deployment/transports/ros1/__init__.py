"""The graph as ROS 1 nodes: Debian's rospy carries the components' messages between processes."""
