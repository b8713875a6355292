"""A run shown while it goes on, on this host only, by processes of their own that the run never waits for."""
