"""The machine: its specification, kinematics, workspace, poses and rendering."""
