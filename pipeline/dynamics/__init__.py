"""Learned dynamics of the arm's actuators (paper, section "Data-driven system identification")."""
