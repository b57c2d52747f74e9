"""What runs the C: images, emulators, the simulated board, models of chips, bounds of time."""
