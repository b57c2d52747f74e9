"""Virtual participants: how they see, move and learn, whatever the study.  Simulated."""
