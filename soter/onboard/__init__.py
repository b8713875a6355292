"""The code that runs on robots: mux, gate and lease, and the drive to a goal.

Standard library only: the same code runs for simulated robots and on real ones.
"""
