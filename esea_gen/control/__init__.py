"""Controllers: sliding mode, reference, limits."""
