"""The cluster file: what it says, and what is wrong with one."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from lndrl.errors import UserError
from lndrl.placement.cluster import load_cluster

WHOLE = {
    "run": "first",
    "settings": ["seed=2"],
    "learner": {
        "host": "gpu",
        "address": "10.0.0.5",
        "listen": 7500,
        "options": ["--device", "cuda"],
    },
    "sites": [{"name": "lab", "host": "door", "address": "10.9.0.1"}],
    "actors": [{"host": ["cpu1", "cpu2"], "count": 4}, {"host": "cpu3", "site": "lab"}],
    "evaluator": {"host": "cpu1"},
}


def written(folder: Path, **changes: object) -> Path:
    path = folder / "cluster.yaml"
    data = {key: value for key, value in {**WHOLE, **changes}.items() if value is not None}
    path.write_text(yaml.safe_dump(data))
    return path


def test_everybody_gets_the_right_command(tmp_path: Path) -> None:
    cluster = load_cluster(written(tmp_path))
    learner = cluster.learner(".lndrl/first/lndrl.yaml", resume=False)
    assert " ".join(learner.words) == (
        "learner --run first --listen tls/0.0.0.0:7500 .lndrl/first/lndrl.yaml --set seed=2"
        " --device cuda"
    )
    assert "--resume" in cluster.learner("x.yaml", resume=True).words
    assert "x.yaml" not in cluster.learner("x.yaml", resume=True).words
    assert [(job.host, job.role, " ".join(job.words)) for job in cluster.others()] == [
        ("door", "site", "site --connect tls/10.0.0.5:7500 --listen tls/0.0.0.0:7447"),
        ("cpu1", "actor", "actor --connect tls/10.0.0.5:7500 --count 4"),
        ("cpu2", "actor", "actor --connect tls/10.0.0.5:7500 --count 4"),
        ("cpu3", "actor", "actor --connect tls/10.9.0.1:7447 --count auto"),
        ("cpu1", "evaluator", "evaluator --connect tls/10.0.0.5:7500"),
    ]
    assert len({job.name for job in cluster.others()}) == 5
    assert cluster.certificates == tmp_path / "first.certs"


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"learners": {}}, "learners"),
        ({"actors": None}, "nobody would simulate"),
        ({"actors": [{"host": "a", "site": "moon"}]}, "the site moon, which is not there"),
        ({"learner": {"host": "gpu", "listen": 70000}}, "learner.listen"),
        ({"actors": [{"host": "a", "count": "many"}]}, "count"),
        ({"run": "a/b"}, "run"),
    ],
)
def test_what_is_wrong_with_a_file_is_said(tmp_path: Path, changes: dict, said: str) -> None:
    with pytest.raises(UserError) as error:
        load_cluster(written(tmp_path, **changes))
    assert str(tmp_path / "cluster.yaml") in str(error.value) and said in str(error.value)


def test_no_file_is_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no such cluster file"):
        load_cluster(tmp_path / "none.yaml")
