"""Study engine: tasks, protocols, crash-safe sessions, participants' rights."""
