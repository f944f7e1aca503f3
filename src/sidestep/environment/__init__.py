"""The Markov decision process: a walker decides at every crossing which street to take. Pure functions only."""
