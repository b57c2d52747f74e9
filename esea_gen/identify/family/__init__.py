"""Members of the elastomer family: fitted, compared, written as a device file."""
