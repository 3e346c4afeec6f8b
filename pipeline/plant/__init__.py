"""The simulated machine: hydraulics, load, sensors, the operator who drives it, and effects to be found."""
