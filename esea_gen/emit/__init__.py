"""One way to C: walker, number formats, ranges, elementary functions, rendering, manifest."""
