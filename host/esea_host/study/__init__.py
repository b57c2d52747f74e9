"""The study engine: tasks, protocols, sessions that lose nothing, and what people are owed."""
