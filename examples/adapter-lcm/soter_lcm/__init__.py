"""Robots that speak LCM: simulated ones, and the adapter that gives them to SOTER."""
