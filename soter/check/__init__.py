"""Checks of safety modules: the conditions and proofs that admit them, and falsification, which tries to break them."""
