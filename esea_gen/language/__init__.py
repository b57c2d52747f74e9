"""What everything speaks: ports, Blocks, Programs, Systems.  It imports nothing of ours."""
