"""What a tunable trades in the tuning case, and which value to take."""
