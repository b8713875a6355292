"""What admits safety modules, and what tries them: conditions, proofs, falsification. What to test is handed in."""
