"""CAN logs of every format that `python-can` reads, with signals by a DBC file."""
