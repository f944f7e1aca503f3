"""Streets. "Network" always means roads here, never neurons."""
