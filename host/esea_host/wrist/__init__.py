"""The wrist study: simulated impairment, virtual normalisation, motor-learning task."""
