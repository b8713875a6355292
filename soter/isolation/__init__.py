"""Runs untrusted code in sandboxed processes of its own, and exchanges messages with it."""
