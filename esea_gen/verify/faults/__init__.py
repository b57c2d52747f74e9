"""The fault campaign: load on the person when a part fails."""
