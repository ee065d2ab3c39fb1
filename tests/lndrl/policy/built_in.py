"""The package's own networks and encoders, as what they are: a user's own could stand there."""

from __future__ import annotations

from lndrl.policy.networks import (
    FanScanEncoder,
    MapEncoder,
    NavigationNetwork,
    Network,
    ScanEncoder,
)


def built_in(network: Network) -> NavigationNetwork:
    assert isinstance(network, NavigationNetwork)
    return network


def scan_encoder_of(network: Network) -> ScanEncoder | FanScanEncoder:
    encoder = built_in(network).scan_encoder
    assert isinstance(encoder, ScanEncoder | FanScanEncoder)
    return encoder


def map_encoder_of(network: Network) -> MapEncoder:
    encoder = built_in(network).map_encoder
    assert isinstance(encoder, MapEncoder)
    return encoder
