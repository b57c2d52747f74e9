"""Proofs of the emitted and the hand-written C, sanitizers, and preemption at every instruction."""
