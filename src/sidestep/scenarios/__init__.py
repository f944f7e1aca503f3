"""Named problems: streets, crowds, speed law and walks, from one seed.

A problem is plain values (:mod:`~sidestep.scenarios.model`), built in by name or read from a file. What it stands for
is drawn in two steps: :func:`~sidestep.scenarios.maps.draw_map` gives map number ``index`` of a seed, streets and their
expected crowds; :func:`~sidestep.scenarios.futures.make_environment` gives futures of these crowds for one *purpose*.
The purpose is part of every random stream, so the futures that planners are compared on can never be those that the
agent was trained on.
"""
