"""SOTER: run-time assurance for robots."""

__version__ = "0.1.0"
