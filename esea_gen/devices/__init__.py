"""Device files and controllers that come with the package, read, checked and written."""

# Least error of the laws that know no future (docs/control.md), and the device that it drives.
BEST_CONTROLLER, BEST_DRIVE = "mpc-no-preview", "elbow_mpc"
