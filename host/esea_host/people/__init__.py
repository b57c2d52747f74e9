"""Virtual participants for any study: perception, movement, learning.  Simulated."""
