"""The emitted C against plant, people, experiments and published tables."""
