"""Spoilt inputs for everything that reads what it was not written for, see `tools/fuzz.py`."""
