"""Draws configurations over everything that a mission file can say, runs them, judges them, shrinks what fails."""
