"""A third simulator: a chain of rigid bodies in MuJoCo, moved by cylinders behind proportional valves.

Neither the plant's equations nor the catalogue's are used. MuJoCo integrates masses, gravity, friction and stops.
What drives the joints is written here: valve drivers and spools, orifices, chambers with compressible oil, one pump
that limits its pressure. Effects are changes of these parts (`effects.py`). Arms have 3 to 7 joints, some of them
prismatic, and take continuous commands.

Per joint, with command a, spool s, chamber pressures pA and pB, piston speed v and piston area A:

    u = a(t - dead time);  τ ṡ = dead band(u) - s                                      hydraulics.py
    Q_A = k s √(p_s - pA),  Q_B = k s √pB   for s > 0, mirrored for s < 0
    ṗA = β / V_A (Q_A - A v - c (pA - pB)),  ṗB = β / V_B (A v + c (pA - pB) - Q_B)
    F = A (pA - pB), on the link unless the piston is within its pin's play
    ṗ_s = β / V_s (Q_pump - Σ Q_in),  Q_pump = limited(g (p_set - p_s))

Source: Merritt, Hydraulic Control Systems, 1967, sections 3-2 (orifices) and 6-1 (valve and piston).
"""
