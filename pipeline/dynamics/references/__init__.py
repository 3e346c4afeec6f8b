"""Reference models of system identification: ARX, NARX, grey box."""
