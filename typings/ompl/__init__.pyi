"""The part of OMPL 2's Python bindings that the planners use (the bindings are not marked as typed)."""
