"""The link to a board: transports, MAVLink frames, the session over them.

It is independent of any device: names and units come from the dialect generated for a device,
passed in as a module.  It imports no other room; the emulator and the host tool both use it.
"""
