"""ROS 2 bags in SQLite (sqlite.org/fileformat2.html)."""
