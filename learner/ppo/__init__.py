"""One update: a batch into samples, advantages, losses and the steps of two networks.

Pure of the service around it: it knows neither who sent the samples nor where a run is kept.
"""
