"""``lndrl down``: end what ``lndrl up`` has started."""

from __future__ import annotations

from lndrl.cli.fleet.up import ClusterFile, check_packages


def down(cluster: ClusterFile) -> None:
    """End everything that lndrl up has started, the learner last, with a checkpoint."""
    check_packages()

    from lndrl.cli.signals import say
    from lndrl.placement.cluster import load_cluster
    from lndrl.placement.launch import down as end

    end(load_cluster(cluster), say)
