"""Learn to move a hydraulic arm from its teleoperation logs, and check its model against measured data.

The layers, each of which imports only what stands to its left (checked by `lint-imports`)::

    errors < machine < logs < dynamics < reaching < control < reporting < stages
    machine < plant (the simulated machine: nothing that learns may import it) < stages
"""
