"""What code costs on a board: bounds of instructions, releases, counted steps."""
