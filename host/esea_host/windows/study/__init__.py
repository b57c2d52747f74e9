"""The windows of a session: what the participant sees, and what the operator holds."""
