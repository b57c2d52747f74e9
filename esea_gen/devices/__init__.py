"""Device files and controllers that come with the package, read, checked and written."""
