"""The studies: what is run, measured and compared, one file a study."""
