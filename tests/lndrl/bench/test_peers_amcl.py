"""The peers' table of the localization benchmark."""

from __future__ import annotations

import pytest

from lndrl.bench.peers import amcl


def test_figures_of_all_beside_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(amcl, "COUNTS", (50,))
    monkeypatch.setattr(amcl, "_TICKS", 10)
    figures = amcl.measure_peers(0.1)
    assert len(figures) == 4
    for name, row in figures.items():
        if "missing" in row:
            continue
        assert row["update_microseconds"]["50x60"] > 0, name
        assert 0 < row["position_rmse"]["50x60"] < 0.5, name


def test_a_missing_package_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(name: str) -> None:
        raise ModuleNotFoundError(name)

    monkeypatch.setattr(amcl, "COUNTS", (50,))
    monkeypatch.setattr(amcl, "_TICKS", 3)
    monkeypatch.setattr(amcl.importlib, "import_module", absent)
    figures = amcl.measure_peers(0.1)
    assert figures[amcl.PEER] == {"missing": "pip install amcl"}
    assert "lndrl beam" in figures
