"""Recordings of runs: MCAP files, their writer, their reader and their summaries."""
