"""Pictures, films and pages of runs."""
