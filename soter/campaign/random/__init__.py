"""Draws configurations over all keys of mission files, runs and judges them, and shrinks those that fail."""
