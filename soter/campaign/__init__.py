"""Campaigns: many runs of missions, what came out of them, and what follows. Above the runner, which knows none."""
