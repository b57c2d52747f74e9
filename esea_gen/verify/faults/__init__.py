"""The fault campaign: what a person at the drive feels when something breaks."""
