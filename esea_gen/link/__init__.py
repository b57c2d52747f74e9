"""The link to a board: transports, MAVLink frames, the session over them.

It knows no device: what a device has comes from the dialect that is generated for it, handed in as
a module.  It imports no other room; the emulator and the host tool both use it.
"""
