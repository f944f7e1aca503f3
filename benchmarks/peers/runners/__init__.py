"""One small module for each peer: ``learn(algorithm, problem, seed, on_check)``, and the packages to name."""
