"""Write trajectories in formats of other projects."""
