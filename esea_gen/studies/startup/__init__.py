"""Start-up of a drive: guided procedures, what they find, and whether the gains may be used."""
