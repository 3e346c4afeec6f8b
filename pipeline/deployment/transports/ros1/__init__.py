"""The graph as ROS 1 nodes: Debian's rospy transports the components' messages between processes."""
