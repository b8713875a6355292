"""The conformance kit: anyone can prove an adapter right. See docs/conformance.md."""

from soter.conformance.harness import HOOKS, Harness

__all__ = ["HOOKS", "Harness"]
