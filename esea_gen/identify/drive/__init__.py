"""Numbers of a drive from its recordings: friction, encoder tables, bring-up."""
