"""Device files that come with the package."""
