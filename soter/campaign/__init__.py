"""Campaigns: many runs of missions, their results, and the judgement on them. The runner does not know of campaigns."""
