"""Guided checks that a person carries out in the laboratory; logic only, no screen."""
