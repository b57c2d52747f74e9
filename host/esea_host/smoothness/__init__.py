"""How smooth a movement is: arrays in, results out; needs NumPy and SciPy alone."""
