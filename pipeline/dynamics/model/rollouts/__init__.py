"""Rollouts of networks in state-space form: along logged commands, and of many sequences of held commands."""
