"""What a segment costs whom: speed by density, crossing times, waits, objectives."""
