"""Published results, each made by one module."""
