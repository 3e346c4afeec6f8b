"""The simulated machine: hydraulics, load, sensors, the scripted operator, and undeclared effects."""
