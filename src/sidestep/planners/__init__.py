"""Who decides where to go next; one protocol for all."""
