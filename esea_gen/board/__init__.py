"""Boards: images, emulators, the simulated board, chip models, time bounds."""
