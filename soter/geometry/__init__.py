"""The world a mission takes place in, and the files that describe it."""
