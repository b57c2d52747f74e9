"""Plant, people, and the closed loop with the emitted C."""
