"""Published tables and figures, recomputed: one file each, which registers itself."""
