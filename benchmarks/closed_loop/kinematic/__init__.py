"""A second simulator, independent of the plant: each joint is a kinematic system of first order.

The plant (`pipeline/plant`) integrates pressures, masses and friction, so that an effect is a change of hydraulics
and its truth is measured on it. Here there are no forces: a command arrives after a dead time, asks for a speed, and
the joint approaches that speed. The contract's effects act literally as its table words them (section 4), so their
truth is exact. What `close_loop` finds in both does not hang on one simulator's idiosyncrasies.

Of the plant, nothing but its scripted operator, the form of its logs and the way it is compiled is used.

Per joint, with command a, position q, drive speed v:

    a_d(t) = a(t - dead time), held at zero for a while where a start sticks   command_path.py
    w      = a_d · full speed · product of factors (pose, gravity, shared supply, process variation, effects)  speed.py
    τ v̇    = w - v, with one τ while the speed grows and another while it falls; q̇ = v but for stops, play, leak,
             lag and resonance                                                  motion.py
    y      = scale · q(t - latency) + offset + noise, quantised                 encoder.py

All first- and second-order systems are discretised exactly for an input that is held over a substep.
"""
