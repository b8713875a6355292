"""Backends: one folder for each kind of robots, with the code that opens them. Backends do not import each other."""
