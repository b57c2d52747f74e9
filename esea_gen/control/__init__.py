"""Control laws and their table, set torque and set-point, limits before the motor."""
