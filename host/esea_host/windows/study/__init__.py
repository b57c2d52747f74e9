"""Windows of a session for participant and operator."""
