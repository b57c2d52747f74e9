"""The MAVLink session: frames, parameters, commands.

It knows no device: what a device has comes from the dialect that is generated for it.  It imports
neither ``esea_gen`` nor ``esea_host``; the emulator and the host tool both use it.
"""
