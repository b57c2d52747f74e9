"""Self-contained HTML pages: of a device, and of an identification."""
