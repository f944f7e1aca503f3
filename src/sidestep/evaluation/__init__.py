"""Comparisons: planners side by side on common random numbers."""
