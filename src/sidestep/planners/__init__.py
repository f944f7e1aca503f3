"""Planners: they decide at every crossing where to go next; one protocol for all."""
