"""The page of a recording: one HTML file that needs no network and plays the run."""
