"""Our numbers against their peers, in the same run."""
