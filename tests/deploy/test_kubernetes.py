"""The Kubernetes files: rendered by kustomize, valid against the published schemas, and safe."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2] / "deploy/kubernetes"
KUSTOMIZE = ["kustomize", "build"] if shutil.which("kustomize") else ["kubectl", "kustomize"]
needs_kustomize = pytest.mark.skipif(
    shutil.which(KUSTOMIZE[0]) is None, reason="needs kustomize or kubectl, which is not installed"
)
VERSIONS = ("1.29", kubernetes_validate.latest_version())


def rendered(overlay: str) -> list[dict[str, Any]]:
    done = subprocess.run([*KUSTOMIZE, str(ROOT / overlay)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return [each for each in yaml.safe_load_all(done.stdout) if each]


def written() -> list[dict[str, Any]]:
    """The resources as they stand in the base."""
    names = yaml.safe_load((ROOT / "base/kustomization.yaml").read_text())["resources"]
    texts = [(ROOT / "base" / name).read_text() for name in names]
    return [each for text in texts for each in yaml.safe_load_all(text)]


def of(resources: list[dict[str, Any]], kind: str, name: str) -> dict[str, Any]:
    (found,) = [r for r in resources if r["kind"] == kind and r["metadata"]["name"] == name]
    return found


@pytest.mark.parametrize("version", VERSIONS)
def test_the_base_is_valid_as_it_stands(version: str) -> None:
    for resource in written():
        kubernetes_validate.validate(resource, version, strict=True)


@needs_kustomize
@pytest.mark.parametrize("overlay", ["base", "gpu"])
def test_what_is_applied_is_valid(overlay: str) -> None:
    resources = rendered(overlay)
    for resource in resources:
        kubernetes_validate.validate(resource, VERSIONS[-1], strict=True)
    images = {
        container["image"]
        for kind, name in (("StatefulSet", "learner"), ("Deployment", "actors"))
        for container in of(resources, kind, name)["spec"]["template"]["spec"]["containers"]
    }
    assert images == {
        "registry.example/lndrl:cpu",
        *(["registry.example/lndrl:cuda"] if overlay == "gpu" else []),
    }
    learner = of(resources, "StatefulSet", "learner")["spec"]["template"]["spec"]["containers"][0]
    assert ("nvidia.com/gpu" in learner["resources"]["limits"]) == (overlay == "gpu")


def test_a_mistake_is_not_valid() -> None:
    broken = of(written(), "Deployment", "actors")
    broken["spec"]["template"]["spec"]["containers"][0]["argz"] = []
    with pytest.raises(kubernetes_validate.ValidationError):
        kubernetes_validate.validate(broken, VERSIONS[-1], strict=True)


def test_every_container_is_confined() -> None:
    for kind, name in (("StatefulSet", "learner"), ("Deployment", "actors")):
        pod = of(written(), kind, name)["spec"]["template"]["spec"]
        assert pod["securityContext"]["runAsNonRoot"] and not pod["automountServiceAccountToken"]
        for container in (*pod["initContainers"], *pod["containers"]):
            rights = container["securityContext"]
            assert rights["readOnlyRootFilesystem"] and not rights["allowPrivilegeEscalation"]
            assert (
                rights["capabilities"] == {"drop": ["ALL"]} and "limits" in container["resources"]
            )
            mounts = {mount["name"] for mount in container["volumeMounts"]}
            known = {volume["name"] for volume in pod["volumes"]} | {"runs"}
            assert mounts <= known


def test_names_meet() -> None:
    resources = written()
    service = of(resources, "Service", "learner")
    labels = of(resources, "StatefulSet", "learner")["spec"]["template"]["metadata"]["labels"]
    assert service["spec"]["selector"] == labels
    scaled = of(resources, "HorizontalPodAutoscaler", "actors")["spec"]
    assert scaled["scaleTargetRef"]["name"] == "actors"
    metric = scaled["metrics"][0]["object"]["metric"]["name"]
    exporter = (ROOT.parents[1] / "lndrl/view/monitoring/families.py").read_text()
    assert metric.removeprefix("lndrl_") in exporter
    for policy in ("learner", "actors"):
        selector = of(resources, "NetworkPolicy", policy)["spec"]["podSelector"]["matchLabels"]
        assert selector == {"app": policy}
