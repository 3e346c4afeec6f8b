"""The reaching task on a learned dynamics model: reward, episodes, environment, metrics."""
