"""How far the sensed torque may be from the true one."""
