"""Faults on purpose: a real run whose processes, network and disk fail by a seed, and its books.

Whether anything was lost is found from the outside, from what actors and learner wrote down.
"""
