"""Robots that SOTER drives by sending velocities to a mux beside their base, over any middleware."""
