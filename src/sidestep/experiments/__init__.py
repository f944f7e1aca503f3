"""Published results, one file each; every docstring lists where we deviate."""
