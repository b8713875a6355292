"""Decides once more what a recording decided."""
