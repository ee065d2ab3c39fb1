"""The endpoints over zenoh: sessions, learner, actor, viewer, and the configurations deployed.

Imported when an endpoint is opened, so that nothing else needs the network library.
"""
