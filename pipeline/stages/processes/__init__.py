"""Processes beside the stages."""
