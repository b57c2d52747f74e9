"""Search for the parameters of the published torque model."""
