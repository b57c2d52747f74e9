"""The q31 number format: range plan, lowering, proven error bounds and integer functions."""
