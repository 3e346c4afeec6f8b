"""The supervisor and its rules, each with what it knows of the machine."""
