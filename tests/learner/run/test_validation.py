"""What the learner makes of evaluators: whom it gives what, which results count, what is kept."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from learner.run.best import read_best, save_best
from learner.run.record import Recorder
from learner.run.validation import Validation
from learner.status import snapshot
from lndrl.curve import read_curve
from lndrl.evaluation.run_metrics import read_metrics
from lndrl.numbering import BEST
from lndrl.policy import initial_weights, read_policy
from lndrl.transport import (
    NO_WEIGHTS,
    EvaluatorHello,
    Refusal,
    ValidationTask,
)
from lndrl.transport.status import parse_status
from lndrl.view.dashboard.screen import plain_line
from tests.learner.helpers_learner import small_config
from tests.learner.run.helpers_validation import (
    EPISODES,
    HELLO,
    Trained,
    counts,
    small,
)


def test_a_result_is_recorded_everywhere(start: Callable[..., Trained]) -> None:
    run = start()
    assert run.validate(3, 18) == "accepted"
    (row,) = run.validation.curve
    assert (row["version"], row["steps"], row["sampled"]["arrived"]) == (3, 3000, 18)
    path = run.learner.folder.path / "metrics.jsonl"
    (line,) = [json.loads(each) for each in path.read_text().splitlines()]
    assert line == {"update": 3, "validation": row}
    assert read_curve(path) == [row]
    said = run.learner.folder.events.read_text()
    assert "join       evaluator evaluator-0 on here\n" in said
    expected = "at step 3,000: 0.90 arrived (0.70-0.97) of 20, 0.10 collided, 0.00 lost, 0.00 stuck"
    assert f" validated  {expected}; greedy 0.00 arrived (0.00-0.16)\n" in said
    status = parse_status(snapshot(run.learner))
    assert status.validation is not None and status.validation.best is not None
    assert [point.sampled.arrived for point in status.validation.points] == [18]
    assert status.validation.best.steps == 3000
    assert "validated 90.0% at 3,000" in plain_line(status)


def test_tensorboard_gets_shares_and_bounds(start, monkeypatch) -> None:
    run = start()
    scalars: dict[str, tuple[float, int]] = {}

    class Board:
        def add_scalar(self, name: str, value: float, step: int) -> None:
            scalars[name] = (value, step)

        def close(self) -> None: ...

    run.learner.recorder._board = Board()
    run.validate(2, 10)
    assert scalars["validation_sampled/arrived"] == (0.5, 2000)
    low, high = (scalars[f"validation_sampled/arrived_{end}"][0] for end in ("low", "high"))
    assert low == pytest.approx(0.299, abs=1e-3) and high == pytest.approx(0.701, abs=1e-3)
    assert scalars["validation_greedy/collided"] == (1.0, 2000)


def test_rows_of_validation_are_none_of_updates(start) -> None:
    run = start()
    run.validate(1, 5)
    path = run.learner.folder.path / "metrics.jsonl"
    with path.open("a") as file:
        file.write(json.dumps({"update": 2, "steps": 64}) + "\n")
    assert [row["update"] for row in read_metrics(path)] == [2]


def test_a_version_counts_once_whatever_is_sent_again(start) -> None:
    run = start()
    run.publish(1)
    result = run.result(run.ask(), 10)
    assert [run.tell(result) for _ in range(3)] == ["accepted", "duplicate", "duplicate"]
    assert len(run.validation.curve) == 1
    assert run.ask().version == NO_WEIGHTS, "nothing is new"
    run.publish(2)
    assert run.ask().version == 2


def test_what_was_not_handed_out_so_is_not_taken(start) -> None:
    run = start()
    run.publish(1)
    task = run.ask()
    good = run.result(task, 10)
    steps = {**counts(3), "steps": EPISODES * run.learner.config.steps_limit + 1}
    forged: dict[str, list[dict[str, Any]]] = {
        "refused": [
            {"run_id": "another"},
            {"sampled": counts(7, 19)},
            {"greedy": counts(7, 21)},
            {"sampled": steps},
        ],
        "stale": [{"learner_incarnation": "another"}, {"version": 2}, {"evaluator_id": "liar"}],
    }
    for status, several in forged.items():
        for changes in several:
            assert run.tell(dataclasses.replace(good, **changes)) == status, changes
    assert run.validation.curve == [] and run.best() is None
    assert run.tell(good) == "accepted"


def test_evaluators_do_not_do_the_same_work(start, monkeypatch) -> None:
    run = start()
    other = dataclasses.replace(HELLO, evaluator_id="evaluator-1")
    run.publish(1)
    assert run.ask().version == 1
    assert run.ask(other).version == NO_WEIGHTS
    again = dataclasses.replace(HELLO, incarnation="second")
    assert run.ask(again).version == 1, "one that was started anew"
    run.publish(2)
    assert run.ask(other).version == 2
    monkeypatch.setattr("learner.run.validation._GIVEN_UP", -1.0)
    assert run.ask().version == 2, "whoever had it is given up"
    run.publish(3)
    assert run.ask(dataclasses.replace(HELLO, ready=False)).version == NO_WEIGHTS, "it rests"


def evaluators(count: int) -> list[EvaluatorHello]:
    return [dataclasses.replace(HELLO, evaluator_id=f"evaluator-{k}") for k in range(count)]


def test_of_many_evaluators_some_wait_and_no_work_is_lost(start) -> None:
    run, hellos = start(), evaluators(3)
    tasks: dict[str, ValidationTask] = {}
    answers = []
    for version in range(1, 10):
        run.publish(version)
        hello = hellos[version % 3]
        held = tasks.pop(hello.evaluator_id, None)
        if held is not None:
            result = run.result(held, 3)
            answers.append(run.tell(dataclasses.replace(result, evaluator_id=hello.evaluator_id)))
        task = run.ask(hello)
        if task.version != NO_WEIGHTS:
            tasks[hello.evaluator_id] = task
        assert len(run.validation._handed) <= 2, "30 MB each"
    assert len(answers) >= 4 and set(answers) == {"accepted"}


def test_those_who_never_answer_are_given_up(start, monkeypatch) -> None:
    run, (first, second, third) = start(), evaluators(3)
    run.publish(1)
    forgotten = run.result(run.ask(first), 3)
    run.publish(2)
    assert run.ask(second).version == 2
    run.publish(3)
    assert run.ask(third).version == NO_WEIGHTS
    monkeypatch.setattr("learner.run.validation._GIVEN_UP", -1.0)
    assert run.ask(third).version == 3
    assert run.tell(forgotten) == "stale"


@pytest.mark.parametrize("change", [{"program_version": "0.0.1"}, {"protocol": 99}])
def test_another_version_is_refused_in_a_sentence(start, change: dict[str, Any]) -> None:
    run = start()
    answer = run.validation.on_evaluator(dataclasses.replace(HELLO, **change))
    assert isinstance(answer, Refusal)
    assert "this learner is lndrl" in answer.reason and answer.reason.endswith("install the same")


def test_a_run_that_validates_nothing_says_so(start) -> None:
    run = start(config=small_config())
    answer = run.validation.on_evaluator(HELLO)
    assert isinstance(answer, Refusal)
    assert "train with --set learner.validation_episodes=100" in answer.reason
    assert snapshot(run.learner)["validation"] is None


def test_the_best_is_judged_with_its_neighbour_and_later_ones_win_ties(start) -> None:
    run = start()
    bests = []
    # 10 | 10+18 | 18+12 | 12+18: as good as the one before, so the later | 18+8
    for version, arrived in enumerate((10, 18, 12, 18, 8), 1):
        run.validate(version, arrived)
        bests.append(run.best())
    assert bests == [1, 2, 3, 4, 4]
    policy = read_policy(run.learner.folder.path)
    assert policy.origin == "best checkpoint, step 4,000, 0.90 of 20 validated"
    assert read_policy(run.learner.folder.path, "newest").origin.startswith("newest checkpoint")


def test_the_best_holds_the_weights_that_were_validated(start) -> None:
    run = start()
    run.publish(1)
    task = run.ask()
    weights = run.evaluator.fetch(1)
    with __import__("torch").no_grad():
        next(run.learner.ppo.policy.parameters()).add_(1.0)
    run.publish(2)
    run.publish(3)
    run.tell(run.result(task, 10))
    from safetensors.torch import load

    kept = load(read_policy(run.learner.folder.path).weights)
    for name, tensor in load(weights).items():
        assert (kept[name] == tensor).all(), name


def test_the_average_is_validated_and_kept_where_actors_act_on_what_is_trained(start) -> None:
    from safetensors.torch import load

    run = start(config=small(average=0.9))
    ppo = run.learner.ppo
    with __import__("torch").no_grad():
        next(ppo.policy.parameters()).add_(1.0)
    assert run.validate(1, 10) == "accepted"
    fetched = run.evaluator.fetch(1)
    acted_on = run.network.desk.weights(1)[1]
    for blob, network in (
        (fetched, ppo.average.network),
        (read_policy(run.learner.folder.path).weights, ppo.average.network),
        (acted_on, ppo.policy),
    ):
        tensors = load(blob)
        assert all((tensors[name] == t).all() for name, t in network.state_dict().items())


def test_keeping_few_checkpoints_never_deletes_the_best(start) -> None:
    run = start()
    run.validate(1, 20)
    for version in range(2, 8):
        run.publish(version)
        run.learner.checkpoint()
    names = sorted(path.name for path in run.learner.folder.checkpoints.iterdir())
    assert names == [BEST, "step-000006000", "step-000007000"]
    assert run.best() == 1


def test_a_full_disk_keeps_the_best_that_there_is(start, monkeypatch) -> None:
    run = start()
    run.validate(1, 5)

    def refuse(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("learner.run.checkpoint._write", refuse)
    run.validate(2, 20)
    assert run.best() == 1 and run.validation.best["version"] == 1
    monkeypatch.undo()
    run.validate(3, 20)
    assert run.best() == 3
    assert "best (step 2,000) cannot be written" in run.learner.folder.events.read_text()


def resumed(start, run: Trained, **options: Any) -> Trained:
    run.learner.end()
    run.learner.close()
    return start(resume=True, **options)


def test_a_resumed_run_goes_on_with_curve_and_best(start) -> None:
    run = start()
    run.validate(1, 10)
    run.validate(2, 16)
    task_of_before = run.result(ValidationTask("x", {}, 2, run.learner.endpoint.incarnation), 20)
    again = resumed(start, run)
    assert [row["version"] for row in again.validation.curve] == [1, 2]
    assert again.validation.best == read_best(again.learner.folder.checkpoints)
    assert again.ask().version == NO_WEIGHTS, "version 2 is known already"
    told = dataclasses.replace(task_of_before, run_id=again.learner.folder.run_id)
    assert again.tell(told) == "stale"
    again.validate(3, 9)
    assert (again.best(), len(again.validation.curve)) == (2, 3)


def test_who_goes_back_leaves_a_later_best_behind(start) -> None:
    run = start()
    run.validate(1, 10)
    run.learner.checkpoint()
    run.validate(2, 16)
    run.learner.checkpoint()
    again = resumed(start, run, checkpoint="step-000001000")
    folder = again.learner.folder.checkpoints
    assert again.best() is None and (folder / f"abandoned-{BEST}").is_dir()
    assert [row["version"] for row in again.validation.curve] == [1]
    assert "the run goes on before it" in again.learner.folder.events.read_text()


def test_other_episodes_are_no_measure(start) -> None:
    run = start()
    run.validate(1, 19)
    again = resumed(start, run, config=small(validation_episodes=10))
    assert again.best() is None
    assert "validation is of other episodes now" in again.learner.folder.events.read_text()


def test_a_damaged_best_is_set_aside_and_training_goes_on(start) -> None:
    run = start()
    run.validate(1, 10)
    policy = run.learner.folder.checkpoints / BEST / "policy.safetensors"
    policy.write_bytes(policy.read_bytes()[:-1] + b"?")
    again = resumed(start, run)
    assert again.best() is None
    assert "best is damaged (policy.safetensors is not what was written)" in (
        again.learner.folder.events.read_text()
    )


def test_a_best_that_a_crash_left_without_its_name_gets_it_back(start) -> None:
    run = start()
    run.validate(1, 10)
    folder = run.learner.folder.checkpoints
    (folder / BEST).rename(folder / f".{BEST}.replaced")
    (folder / f".{BEST}.partial").mkdir()
    again = resumed(start, run)
    assert again.best() == 1
    assert not list(folder.glob(".best*"))


@pytest.mark.parametrize(
    "line", ['{"validation": 1}', '{"validation": {"version": "x"}}', '{"validation"', "[" * 9999]
)
def test_damaged_rows_of_the_curve_are_left_out(tmp_path: Path, line: str) -> None:
    path = tmp_path / "metrics.jsonl"
    path.write_text(f'{line} "validation"\n{line}\n')
    assert read_curve(path) == []
    assert read_curve(tmp_path / "none") == []


@pytest.mark.parametrize(
    "change", [{"arrived": EPISODES + 1}, {"lost": -1}, {"episodes": 10**400}, {"collided": 3}]
)
def test_rows_that_cannot_be_are_left_out(start, change: dict[str, int]) -> None:
    run = start()
    run.validate(1, 18)
    path = run.learner.folder.path / "metrics.jsonl"
    assert len(read_curve(path)) == 1
    row = json.loads(path.read_text().splitlines()[0])
    row["validation"]["sampled"] |= change
    path.write_text(json.dumps(row) + "\n")
    assert read_curve(path) == []


def test_results_that_nobody_took_yet_survive_the_end(start) -> None:
    run = start()
    run.publish(1)
    ack = run.evaluator.report(run.result(run.ask(), 10))
    assert ack is not None and ack.status == "accepted"
    run.learner.end()
    assert [row["version"] for row in read_curve(run.learner.folder.path / "metrics.jsonl")] == [1]


def test_files_of_best(tmp_path: Path) -> None:
    config = small()
    assert read_best(tmp_path) is None
    facts = {"version": 3, "steps": 64, "unix": 1.5, "score": 0.5, "under": "x"}
    facts |= {"sampled": counts(4), "greedy": counts(5)}
    save_best(tmp_path, config, initial_weights(config), facts)
    found = read_best(tmp_path)
    assert found is not None and {name: found[name] for name in facts} == facts
    (tmp_path / BEST / "validation.json").write_text('{"version": "3"}')
    with pytest.raises(ValueError, match="says no version"):
        read_best(tmp_path)


def test_a_validation_without_a_recorder_to_write_is_still_known(tmp_path: Path) -> None:
    """The disk refuses metrics.jsonl: the curve of this session goes on."""
    run = Trained(tmp_path / "run")
    assert isinstance(run.validation, Validation) and isinstance(run.learner.recorder, Recorder)
    run.learner.recorder._file.path = tmp_path / "nowhere" / "metrics.jsonl"
    run.learner.recorder._file._release()
    assert run.validate(1, 4) == "accepted"
    assert len(run.validation.curve) == 1
    run.learner.close()
