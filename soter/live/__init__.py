"""Live views of a run, on this host only, by processes of their own that the run never waits for."""
