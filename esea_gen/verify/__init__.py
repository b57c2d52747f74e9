"""Evidence that the emitted C is the symbolic model."""
