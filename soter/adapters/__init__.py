"""Backends: the code that opens robots of one kind, one folder each. A folder imports no other folder."""
