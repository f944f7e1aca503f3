"""DARP itself: a dueling deep Q-network with prioritised replay that learns by walking."""
