"""The same mission with modules left out, and what that costs."""
