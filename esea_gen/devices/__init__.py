"""Device files and controllers that come with the package, read, checked and written."""

# Least error of the laws without preview (docs/laws-compared.md), and the device that it drives.
BEST_CONTROLLER, BEST_DRIVE = "mpc-no-preview", "elbow_mpc"
