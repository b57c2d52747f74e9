"""Windows: the live view.  What it shows is kept by plain objects; Qt is imported only to draw."""
