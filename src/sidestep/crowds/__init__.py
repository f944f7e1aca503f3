"""Crowds: how many people are where, and when.

`counts` has the counts of sensors. `count_reader` reads them from files in any layout: `sheets` finds columns and
cells, `layouts` (with `column_names`) which column is for what, `dates`, `cell_numbers` and `count_entries` what cells
say, `count_clock` (with `wall_time`, which knows timezones) when that was. `repairs` removes faults; `count_files` has
the files that stand beside counts, and writes them. `arima`, `profile` and `sensor_model` fit time series to counts;
`summary` is what ``sidestep counts`` reports. `table_reader` reads tables of crowds on whole streets, which
`crowd_table` keeps.

Flow models make crowds on all segments of a network: `arima` (the paper's), `rush` (synthetic rush hours), `sensors`
(with `interpolation` along the streets) and `table_flow`. `base` has what all of them share.
"""
