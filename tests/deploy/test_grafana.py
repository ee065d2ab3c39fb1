"""The files for Prometheus and Grafana: their form, and alerts by Prometheus' own test runner."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
GRAFANA = ROOT / "deploy/grafana"
DASHBOARD = GRAFANA / "dashboards/lndrl.json"
needs_promtool = pytest.mark.skipif(
    shutil.which("promtool") is None, reason="needs promtool (package prometheus), not installed"
)


def promtool(*arguments: str) -> None:
    done = subprocess.run(["promtool", *arguments], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stdout + done.stderr


@needs_promtool
def test_prometheus_takes_what_is_to_be_scraped_and_the_rules() -> None:
    for name in ("prometheus.yml", "prometheus-compose.yml"):
        promtool("check", "config", str(GRAFANA / name))


@needs_promtool
def test_every_alert_fires_when_it_should_and_else_is_silent() -> None:
    promtool("test", "rules", "tests/deploy/alerts.yml")


def test_every_alert_is_tested_and_says_what_and_what_to_do() -> None:
    tested = (ROOT / "tests/deploy/alerts.yml").read_text()
    (group,) = yaml.safe_load((GRAFANA / "rules.yml").read_text())["groups"]
    page = (ROOT / "docs/metrics.md").read_text()
    for rule in group["rules"]:
        assert f'alertname="{rule["alert"]}", instance' in tested
        assert f"| `{rule['alert']}` |" in page
        assert rule["labels"]["severity"] in ("critical", "warning")
        assert "$labels.instance" in rule["annotations"]["summary"]
        assert len(rule["annotations"]["description"]) > 40


def panels() -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads(DASHBOARD.read_text())["panels"]
    return found


def test_panels_have_places_of_their_own_units_and_queries_of_the_chosen_source() -> None:
    taken: set[tuple[int, int]] = set()
    assert len({panel["id"] for panel in panels()}) == len(panels())
    for panel in panels():
        place = panel["gridPos"]
        cells = {
            (x, y)
            for x in range(place["x"], place["x"] + place["w"])
            for y in range(place["y"], place["y"] + place["h"])
        }
        assert place["x"] + place["w"] <= 24 and not cells & taken, panel["title"]
        taken |= cells
        if panel["type"] == "row":
            continue
        assert panel["fieldConfig"]["defaults"]["unit"]
        assert [t["refId"] for t in panel["targets"]] == list("ABCDEF")[: len(panel["targets"])]
        for target in panel["targets"]:
            assert target["datasource"] == {"type": "prometheus", "uid": "${source}"}
            assert 'instance=~"$instance"' in target["expr"], target["expr"]


def test_dashboard_and_rules_name_only_what_is_served() -> None:
    page = (ROOT / "docs/metrics.md").read_text()
    known = set(re.findall(r"^\| `(lndrl_\w+)`", page, re.MULTILINE)) | {"lndrl_up"}
    texts = [DASHBOARD.read_text(), (GRAFANA / "rules.yml").read_text()]
    for name in set(re.findall(r"\blndrl_\w+", "\n".join(texts))):
        assert re.sub(r"_bucket$", "", name) in known, name


def test_containers_mount_what_is_there_and_grafana_finds_it() -> None:
    services = yaml.safe_load((GRAFANA / "compose.yaml").read_text())["services"]
    mounted: dict[str, Path] = {}
    for service in services.values():
        for volume in service["volumes"]:
            source, target, *_ = volume.split(":")
            if source.startswith("."):
                mounted[target] = (ROOT / "deploy/container" / source).resolve()
                assert mounted[target].exists(), volume
        assert all(port.startswith("127.0.0.1:") for port in service["ports"])
    providers = yaml.safe_load(
        (mounted["/etc/grafana/provisioning"] / "dashboards/lndrl.yaml").read_text()
    )["providers"]
    assert (mounted[providers[0]["options"]["path"]] / "lndrl.json").is_file()
    source = yaml.safe_load(
        (mounted["/etc/grafana/provisioning"] / "datasources/prometheus.yaml").read_text()
    )["datasources"][0]
    assert source["url"] == "http://prometheus:9090" and "prometheus" in services
    scraped = yaml.safe_load(mounted["/etc/prometheus/prometheus.yml"].read_text())
    (target,) = scraped["scrape_configs"][0]["static_configs"][0]["targets"]
    others = yaml.safe_load((ROOT / "deploy/container/compose.yaml").read_text())["services"]
    assert target.split(":")[0] in others
    own = yaml.safe_load((GRAFANA / "prometheus.yml").read_text())
    assert [c["job_name"] for c in own["scrape_configs"]] == ["lndrl"], "as the rules say"
