"""Replays recordings: makes the decision modules decide again, and compares."""
