"""From a request for a route to the planned route, and its formats."""
