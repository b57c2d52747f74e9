"""Paired comparisons, effect sizes, power: arrays in, results out."""
