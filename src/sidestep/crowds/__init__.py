"""Crowds: how many people are where, and when.

`counts` and `repairs` read and repair the counts of sensors; `arima`, `profile` and `sensor_model` fit time series to
them; `summary` is what ``sidestep counts`` reports; `live` has the current counts that forecasts go on from.
`table_reader` reads tables of crowds on whole streets, which `crowd_table` keeps.

Flow models make crowds on all segments of a network: `arima` (the paper's), `rush` (synthetic rush hours), `sensors`
(with `interpolation` along the streets) and `table_flow`. `base` has what all of them share.
"""
