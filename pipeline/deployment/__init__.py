"""Controllers on the machine: the graph of the paper's appendix "ROS-based computational pipelines"."""
