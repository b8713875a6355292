"""What runs on robots: who may move them, for how long, and how they drive to a place.

Standard library only: the same code stands in front of simulated robots and runs on real ones.
"""
