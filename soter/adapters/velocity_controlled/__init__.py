"""Robots that SOTER drives by streaming velocities to a mux beside their base, whatever carries the messages."""
