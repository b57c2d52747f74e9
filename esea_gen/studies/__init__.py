"""Studies, one file each: cases, measures, comparison."""
