"""Untrusted code in processes of its own: started, boxed in, spoken with."""
