"""Ablation: runs the same mission with one thing changed or left out, and compares."""
