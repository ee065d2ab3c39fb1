"""Results packed to be handed on: the same rows in fewer bytes, read like any results folder."""

from __future__ import annotations

import csv
import dataclasses
import json
import lzma
import math
import shutil
from pathlib import Path

import numpy as np
import pytest

import lndrl.evaluation.benchmark.handing as handing
from lndrl.cli.main import run as lndrl
from lndrl.errors import UserError
from lndrl.evaluation.benchmark import (
    BENCHMARK,
    Contender,
    Identity,
    Plan,
    ResultsFolder,
    benchmark_table,
    check_bench,
    load_benchmark,
    pack,
    pack_trainings,
    rows_of,
    trainings_of,
)
from lndrl.evaluation.benchmark.store import COLUMNS
from lndrl.evaluation.hazard import Hazard
from lndrl.navigation import EpisodeRecord
from lndrl.navigation.episode import OUTCOMES
from lndrl.navigation.families import Family
from lndrl.navigation.reward import REWARD_PARTS
from lndrl.planners import planner_source
from tests.lndrl.evaluation.benchmark.trainings.trained import digits, write_run

METHODS = ("dwa", "careful+map")
PLACES = ("hall", "sparse")
FIGURES = len(REWARD_PARTS) + 6
VERSION = load_benchmark().version
NEXT = VERSION + 1


def record(random: np.random.Generator, k: int, family: Family = Family.BENCH) -> EpisodeRecord:
    figures = random.uniform(0, 30, FIGURES).tolist()
    return EpisodeRecord.from_dict(
        {
            "world": family.world(k),
            "episode": 0,
            "outcome": random.choice(OUTCOMES).item(),
            "steps": int(random.integers(1, 125)),
            **dict(zip(COLUMNS[3:9], figures, strict=False)),
            "reward_parts": dict(zip(REWARD_PARTS, figures[6:], strict=True)),
        }
    )


def filled(path: Path, episodes: int = 9, **identity: object) -> ResultsFolder:
    """A results folder with rows of all METHODS on all PLACES."""
    folder, random = ResultsFolder(path), np.random.default_rng(3)
    bench = load_benchmark()
    known = Identity(
        0,
        "0.1",
        {place: bench.frozen[place] for place in PLACES},
        {name: {"identity": name} for name in METHODS},
        {place: ["localization.delay=1"] for place in PLACES},
        bench_version=VERSION,
    )
    folder.claim(dataclasses.replace(known, **identity))  # type: ignore[arg-type]
    family = folder.family
    for name in METHODS:
        for place in PLACES:
            folder.keep(name, place, [record(random, k, family) for k in range(episodes)])
    return folder


def test_packed_rows_are_the_same_to_the_last_digit(tmp_path: Path) -> None:
    folder = filled(tmp_path / "own")
    files = pack(folder, tmp_path / "packed", 8)
    packed = ResultsFolder(tmp_path / "packed")
    assert sorted(file.name for file in packed.path.iterdir()) == sorted(
        ["benchmark.json", *(f"{name}-{place}.csv.xz" for name in METHODS for place in PLACES)]
    )
    for name in METHODS:
        for place in PLACES:
            all_there = folder.records(name, place)
            assert packed.records(name, place) == {k: all_there[k] for k in range(8)}
    assert rows_of(packed) == rows_of(folder, episodes=8)
    # Anybody can open them: text in the compression that pandas and xz know by the name.
    with lzma.open(files[0], "rt") as file:
        assert [row["episode"] for row in csv.DictReader(file)] == [str(k) for k in range(8)]


def test_the_same_results_are_the_same_bytes(tmp_path: Path) -> None:
    folder = filled(tmp_path / "own")
    content = [
        [file.read_bytes() for file in pack(folder, tmp_path / name, 9)] for name in ("a", "b")
    ]
    assert content[0] == content[1]
    # A packed folder can be packed, too.
    again = pack(ResultsFolder(tmp_path / "a"), tmp_path / "c", 9)
    assert [file.read_bytes() for file in again] == content[0]


def test_rows_of_the_bench_take_few_bytes(tmp_path: Path) -> None:
    """Seven methods on five places fit into 2 MB: below 57 kB for each."""
    random = np.random.default_rng(0)
    folder = ResultsFolder(tmp_path)
    folder.pack("m", "s", [record(random, k) for k in range(500)])
    assert folder.packed("m", "s").stat().st_size < 57_000


def test_what_is_packed_must_be_whole(tmp_path: Path) -> None:
    folder = filled(tmp_path / "own")
    short = [record(np.random.default_rng(0), k) for k in range(4)]
    folder.keep("careful+map", "sparse", short)
    with pytest.raises(UserError, match=r"has 4 of 9 episodes of careful\+map on sparse"):
        pack(folder, tmp_path / "packed", 9)
    assert not (tmp_path / "packed").exists()
    assert len(pack(folder, tmp_path / "packed", 9, ["dwa"])) == 2
    assert len(pack(folder, tmp_path / "packed", 9, scenarios=["hall"])) == 2
    assert set(Identity.read(tmp_path / "packed/benchmark.json").methods) == set(METHODS)
    with pytest.raises(UserError, match="has 0 of 9 episodes of nobody on hall"):
        pack(folder, tmp_path / "packed", 9, ["nobody"])
    with pytest.raises(UserError, match="holds no results"):
        pack(ResultsFolder(tmp_path / "nothing"), tmp_path / "packed", 9)


def test_how_policies_were_trained_goes_along(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_run(Path("runs/one"))
    sampled = {"actions": "sampled"}
    one = sampled | {"planner": "runs/one", "identity": f"{digits('best')} at 0.25"}
    shielded = one | {"identity": f"{digits('best')} at 0.25 shield {{}}"}
    later = one | {"identity": digits("newest")}
    gone = sampled | {"planner": "runs/gone", "identity": digits("gone")}
    shipped = sampled | {"planner": "shipped", "identity": digits("shipped")}
    methods = {"one": one, "one+shield": shielded, "later": later, "gone": gone, "s": shipped}
    folder = filled(Path("own"), methods={name: {"identity": "rule"} for name in METHODS})
    random = np.random.default_rng(5)
    for name in methods:
        for place in PLACES:
            folder.keep(name, place, [record(random, k) for k in range(9)])
    identity = Identity.read(folder.path / "benchmark.json")
    identity.methods.update(methods)
    identity.write(folder.path / "benchmark.json")
    command = ["benchmark", "--episodes", "9", "--pack"]
    assert lndrl([*command, "packed", "--from", "own"]) == 0
    told = capsys.readouterr()
    assert "packed: 14 files of 9 episodes each, how 2 policies had been trained, 0." in told.out
    assert "how these were trained is not packed: gone; no run folder here holds the" in told.err
    # A run that cannot be read hides no episode.
    Path("runs/one/metrics.jsonl").unlink()
    assert trainings_of(folder)["one"] is None
    # What is packed needs its run no more.
    shutil.rmtree("runs")
    found = trainings_of(ResultsFolder(Path("packed")))
    assert {name: each and each.tested for name, each in found.items()} == {
        "one": 200, "one+shield": 200, "later": 500, "gone": None,
    }  # fmt: skip
    assert lndrl([*command, "again", "--from", "packed"]) == 0
    kept = sorted(Path("packed").glob("one-*-training.jsonl.xz"))
    assert len(kept) == 2
    assert all(Path("again", each.name).read_bytes() == each.read_bytes() for each in kept)
    # What the target has is not missed, though its run is gone and the source does not keep it.
    assert pack_trainings(folder, Path("packed"), ["one"]) == ([], [])
    assert lndrl([*command, "rules", "--from", "own", "--methods", "dwa"]) == 0
    assert not list(Path("rules").glob("*training*"))


def test_a_damaged_file_is_named(tmp_path: Path) -> None:
    folder = ResultsFolder(tmp_path)
    folder.pack("m", "s", [record(np.random.default_rng(0), k) for k in range(5)])
    path = folder.packed("m", "s")
    whole = path.read_bytes()
    for damage in (whole[:-9], b"episode", whole[:80] + b"\0" + whole[81:]):
        path.write_bytes(damage)
        with pytest.raises(UserError, match=r"m-s\.csv\.xz: is damaged"):
            folder.records("m", "s")


def test_a_folder_says_whose_episodes_it_holds(tmp_path: Path) -> None:
    folder = filled(tmp_path / "own", family="calibration")
    pack(folder, tmp_path / "packed", 9)
    for each in (folder, ResultsFolder(tmp_path / "packed")):
        worlds = {k: r.world for k, r in each.records("dwa", "hall").items()}
        assert worlds == {k: Family.CALIBRATION.world(k) for k in range(9)}
    # Folders from before there were families are the bench's, of its first version.
    data = json.loads((folder.path / "benchmark.json").read_text())
    old = {k: v for k, v in data.items() if k not in ("family", "bench_version")}
    (folder.path / "benchmark.json").write_text(json.dumps(old))
    assert folder.family is Family.BENCH
    assert Identity.read(folder.path / "benchmark.json").bench_version == 1
    (folder.path / "benchmark.json").write_text(json.dumps({**data, "family": "training"}))
    with pytest.raises(UserError, match=r"benchmark\.json: cannot be read \('training' is not"):
        folder.records("dwa", "hall")


def test_versions_and_families_do_not_mix(tmp_path: Path) -> None:
    folder = filled(tmp_path / "own", bench_version=NEXT)
    identity = Identity.read(folder.path / "benchmark.json")
    for other, words in (
        (
            {"bench_version": VERSION},
            f"holds results of version {NEXT} of the bench, which do not go into",
        ),
        ({"family": "calibration"}, "was filled with episodes of bench, not of calibration"),
    ):
        with pytest.raises(UserError, match=words):
            folder.claim(dataclasses.replace(identity, **other))
    second = load_benchmark().model_copy(update={"version": NEXT})
    check_bench(second, folder)
    with pytest.raises(
        UserError, match=rf"version {NEXT} of the bench, which do not .* version {VERSION}"
    ):
        check_bench(load_benchmark(), folder)


def test_rows_have_version_and_hazard(tmp_path: Path) -> None:
    folder = filled(tmp_path / "own", bench_version=NEXT)
    rows = rows_of(folder)
    data = rows[0].to_dict()
    lost = sum(r.outcome == "lost" for r in rows[0].records.values())
    steps = sum(r.steps for r in rows[0].records.values())
    assert data["bench_version"] == NEXT
    assert data["hazard"] == pytest.approx(1000 * lost / steps)
    low, high = data["intervals"]["hazard"]
    assert low < data["hazard"] < high
    inside = rows[0].within("hall")
    assert inside.bench_version == NEXT and {place for place, _ in inside.records} == {"hall"}
    table = benchmark_table(rows, "all")
    heads = [str(column.header) for column in table.columns]
    cells = [next(iter(column.cells)) for column in table.columns]
    shown = dict(zip(heads, cells, strict=True))
    assert heads[heads.index("LR") + 1] == "h (‰)"
    assert shown["h (‰)"].startswith(f"{data['hazard']:.2f}\n")  # type: ignore[union-attr]
    assert shown["SR"].startswith(f"{data['sr']:.3f}\n")  # type: ignore[union-attr]
    paper = {head: list(column.cells)[1] for head, column in zip(heads, table.columns, strict=True)}
    assert (paper["LR"], paper["h (‰)"], paper["SR"]) == ("0.035", "-", "0.012")


def test_a_hazard_forgives_nobody_who_collides_early() -> None:
    random = np.random.default_rng(0)
    lost, early, late = (
        EpisodeRecord.from_dict({**record(random, 0).to_dict(), "outcome": outcome, "steps": steps})
        for outcome, steps in (("lost", 40), ("collided", 10), ("arrived", 150))
    )
    assert Hazard.of([lost, early, late]).value == pytest.approx(5.0)
    assert Hazard.of([lost, early]).value == pytest.approx(20.0)
    # Exact Poisson limits of 10 counts are 4.80 and 18.39.
    assert Hazard(10, 10_000).interval == pytest.approx((0.480, 1.839), rel=0.15)
    assert Hazard.of([]).value == 0.0 and Hazard.of([]).interval == (0.0, math.inf)


# -- the command ----------------------------------------------------------------------------


@pytest.fixture
def shipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to work in, and results that come with the program."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(handing, "SHIPPED", tmp_path / "docs/results")
    pack(filled(tmp_path / "made"), tmp_path / f"docs/results/v{VERSION}", 9)
    return tmp_path


def table(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[list[dict], str]:
    assert lndrl(["benchmark", "--json", *arguments]) == 0
    out, err = capsys.readouterr()
    return json.loads(out), err


def test_a_clean_clone_shows_what_comes_with_the_program(
    shipped: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows, said = table(capsys, "--table")
    assert [row["method"] for row in rows] == list(METHODS)
    wanted = {"ar", "cr", "lr", "sr", "hazard", "variance_sum", "bench_version"}
    assert all(wanted <= set(row) and row["bench_version"] == VERSION for row in rows)
    assert "holds no results yet; shown are those in" in said and said.count("\n") == 1
    # Results of one's own come first.
    filled(shipped / "results/benchmark", episodes=2)
    rows, said = table(capsys, "--table")
    assert [row["episodes"] for row in rows] == [4, 4] and said == ""


def test_without_them_there_are_none(
    shipped: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    own = shipped / "bench.yaml"
    own.write_text(BENCHMARK.read_text())
    for arguments in (["--name", "benchmark"], ["--spec", str(own)]):
        assert lndrl(["benchmark", "--table", *arguments]) == 2
        assert "results/benchmark: holds no results of lndrl benchmark" in capsys.readouterr().err
    monkeypatch.setattr(handing, "SHIPPED", shipped / "of a wheel")
    assert lndrl(["benchmark", "--table"]) == 2
    assert "results/benchmark: holds no results of lndrl benchmark" in capsys.readouterr().err


def test_any_folder_is_shown_and_packed(shipped: Path, capsys: pytest.CaptureFixture[str]) -> None:
    filled(shipped / "results/mine", 3)
    rows, _ = table(capsys, "--from", "results/mine", "--methods", "dwa")
    assert [(row["method"], row["episodes"]) for row in rows] == [("dwa", 6)]
    assert lndrl(["benchmark", "--name", "mine", "--pack", "handed", "--episodes", "3"]) == 0
    assert "handed: 4 files of 3 episodes each, 0.00 MB" in capsys.readouterr().out
    rows, said = table(capsys, "--from", "handed", "--scenarios", "hall")
    assert [row["episodes"] for row in rows] == [3, 3] and said == ""


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--from", "nowhere"], "nowhere: holds no results of lndrl benchmark"),
        (["--from", "made", "--name", "b"], "--from made and --name b name two folders"),
        (["--from", "made", "--pack", "p"], "made: has 9 of 500 episodes of dwa on hall"),
        (["--from", "second"], f"second holds results of version {NEXT} of the bench"),
        (
            ["--from", "second", "--pack", "p"],
            f"second holds results of version {NEXT} of the bench",
        ),
        (["--from", "made", "--pack", "made/benchmark.json", "--episodes", "2"], "cannot be made"),
    ],
)
def test_bad_input_is_one_sentence(
    arguments: list[str], sentence: str, shipped: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    filled(shipped / "second", bench_version=NEXT)
    assert lndrl(["benchmark", *arguments]) == 2
    error = capsys.readouterr().err.strip()
    assert sentence in error and len(error.splitlines()) == 1
    assert not (shipped / "p").exists()


def test_a_packed_folder_can_be_gone_on_with(tmp_path: Path) -> None:
    """Its episodes count as run."""
    dwa = Contender("straight", planner_source("straight"), "amcl")
    plan = Plan(ResultsFolder(tmp_path / "own"), [dwa], ["sparse"], 8, 3)
    plan.run(0)
    pack(plan.folder, tmp_path / "packed", 8)
    on = Plan(ResultsFolder(tmp_path / "packed"), [dwa], ["sparse"], 9, 3)
    assert on.left() == 8
    assert on.folder.records("straight", "sparse") == plan.folder.records("straight", "sparse")


def test_git_keeps_what_comes_with_the_program() -> None:
    """Though not what runs leave in folders of the same name."""
    root = handing.SHIPPED.parents[1]
    ignored = (root / ".gitignore").read_text("utf-8").split()
    for part in handing.SHIPPED.relative_to(root).parts:
        assert not {part, f"{part}/", f"**/{part}/"} & set(ignored)
