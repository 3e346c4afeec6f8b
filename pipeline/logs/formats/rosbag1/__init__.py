"""ROS 1 bags, version 2.0 (wiki.ros.org/Bags/Format/2.0)."""
