"""Models of the actuator's parts: symbols in, Blocks out."""
