"""Published tables and figures, computed anew: one file each, which registers itself."""
