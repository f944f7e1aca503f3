"""Crowds: how many people are where, and when.

`counts` loads and repairs real sensor counts (`repairs` holds the repairs as small array functions), `arima` and
`profile` are the two time-series models that learn from them, `skill` measures how well they predict, and `field`
spreads their volumes over the streets.
"""
