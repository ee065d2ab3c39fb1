"""The path of GPUs against the path of CPUs; the same on a real GPU where there is one."""

from __future__ import annotations

import inspect
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import ClassVar, cast

import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode

from learner.ppo.batch import assemble
from learner.ppo.graphs import GraphedStep
from learner.ppo.rollout_store import RolloutStore
from learner.ppo.update import PPO, DivergedError
from learner.run.checkpoint import Counters, load_checkpoint, save_checkpoint
from lndrl.policy import record_cuda_graph
from tests.learner.helpers_learner import random_trajectory, small_config

ON_GPU = pytest.param("cuda", marks=pytest.mark.cuda)
SETTINGS = {"actor_learning_rate": 1e-3, "gradient_norm": 1e3}


@pytest.fixture
def trainer(monkeypatch):
    # GPUs would round the inputs of convolutions to ten bits of mantissa.
    monkeypatch.setattr(torch.backends.cudnn, "allow_tf32", False)
    made = []

    def make(device: str = "cpu", dense: bool = False, learner: dict | None = None, **ppo) -> PPO:
        learner = {"precision": "float32", "device": device, **(learner or {})}
        made.append(PPO(small_config(ppo={**SETTINGS, **ppo}, learner=learner), dense))
        return made[-1]

    yield make
    for each in made:
        each.close()


def batches(ppo: PPO, count: int, store: RolloutStore | None = None):
    """One after the other, as a learner assembles them."""
    for seed in range(count):
        yield assemble([random_trajectory(ppo.config, 10 * seed + k) for k in (1, 2, 3)], store)


def assert_same(
    one: PPO, other: PPO, tolerance: float = 1e-4, weights: float | None = None
) -> None:
    """Means of the gradients and ``weights``, each relative to the largest of its tensor."""
    for network in ("policy", "value"):
        mine, theirs = getattr(one, network), getattr(other, network)
        moments = [getattr(ppo, f"{network}_optimizer").state for ppo in (one, other)]
        for (name, a), b in zip(mine.named_parameters(), theirs.parameters(), strict=True):
            means = moments[0][a]["exp_avg"], moments[1][b]["exp_avg"]
            close = tolerance, weights or tolerance
            for (x, y), most in zip((means, (a.detach(), b.detach())), close, strict=True):
                scale = float(x.abs().max()) + 1e-9
                assert float((x - y.cpu()).abs().max()) < most * scale, name


@pytest.mark.parametrize("device", ["cpu", ON_GPU])
@pytest.mark.parametrize("joint", [False, True])
@pytest.mark.parametrize("minibatch_size", [16, None])
def test_a_gradient_step_is_the_same(trainer, device, joint, minibatch_size) -> None:
    same = {"joint_gradient_norm": joint, "minibatch_size": minibatch_size, "epochs": 1}
    sparse, dense = trainer(**same), trainer(device, dense=True, **same)
    (batch,) = batches(sparse, 1)
    figures, expected = dense.update(batch, 0.25), sparse.update(batch, 0.25)
    # The last gradient was taken after other steps of Adam, which magnify what is tiny: of a bias
    # whose gradient is as small as its epsilon the weight differs more than the gradient does.
    if minibatch_size is None:
        assert_same(sparse, dense, 1e-4, weights=1e-3)
    else:
        assert_same(sparse, dense, 1e-2)
    for name, figure in expected.items():
        assert figures[name] == pytest.approx(figure, rel=1e-4, abs=1e-6), name


@pytest.mark.parametrize("device", ["cpu", ON_GPU])
def test_a_critic_that_knows_more_learns_the_same(trainer, device) -> None:
    """Recorded steps read the floats from memory that moves only when they say so."""
    knows = {"learner": {"privileged_critic": True}, "epochs": 3}
    plain, graphed = trainer(**knows), trainer(device, dense=True, **knows)
    if device == "cpu":
        for trainee in (graphed._actor, graphed._critic):
            trainee.graphed = GraphedStep(trainee._whole_step, lambda work: work)
    # Without a store every batch has memory of its own: what is recorded must not read there.
    store = RolloutStore(pinned=True) if device == "cuda" else None
    places = set()
    for progress, batch in enumerate(batches(plain, 3, store)):
        expected = plain.update(batch, 0.2 * progress)
        figures = graphed.update(batch, 0.2 * progress)
        for name in ("policy_loss", "value_loss", "explained_variance", "gradient_norm_value"):
            assert figures[name] == pytest.approx(expected[name], rel=1e-3, abs=1e-5), name
        places.add(graphed.samples.privileged.data_ptr())
    assert_same(plain, graphed, 2e-2)
    assert len(places) == 1
    larger = [random_trajectory(plain.config, seed) for seed in range(9)]
    assert graphed.samples.load(assemble(larger, store))


@pytest.mark.parametrize("device", ["cpu", ON_GPU])
def test_recorded_steps_train_the_same(trainer, device) -> None:
    """Several updates in reused memory, with a stand-in for the recorder on the CPU."""
    plain = trainer(epochs=3)
    graphed = trainer(device, dense=True, epochs=3)
    if device == "cpu":
        for trainee in (graphed._actor, graphed._critic):
            trainee.graphed = GraphedStep(trainee._whole_step, lambda work: work)
    store = RolloutStore(pinned=device == "cuda")
    for progress, batch in enumerate(batches(plain, 3, store)):
        expected = plain.update(batch, 0.2 * progress)
        figures = graphed.update(batch, 0.2 * progress)
        for name in ("policy_loss", "value_loss", "entropy", "learning_rate"):
            assert figures[name] == pytest.approx(expected[name], rel=1e-3, abs=1e-5), name
    assert graphed._actor.graphed is not None and graphed._actor.graphed._graphs


@pytest.mark.parametrize("device", ["cpu", ON_GPU])
@pytest.mark.parametrize("good", [0, 2])
def test_recorded_steps_go_on_from_before_a_spoilt_update(trainer, device, good: int) -> None:
    """What graphs have recorded is restored in place: they train on as if nothing had been."""
    one, other = (trainer(device, dense=True, epochs=3) for _ in range(2))
    if device == "cpu":
        for trainee in (one._actor, one._critic, other._actor, other._critic):
            trainee.graphed = GraphedStep(trainee._whole_step, lambda work: work)
    fine = list(batches(one, good + 2))
    spoilt = assemble([random_trajectory(one.config, seed) for seed in (91, 92, 93)])
    spoilt.trajectories[1].reward[0, 0] = float("nan")
    for batch in fine[:good]:
        for ppo in (one, other):
            ppo.update(batch, 0.0)
    for _ in range(2):
        with pytest.raises(DivergedError):
            one.update(spoilt, 0.0)
    assert one.is_finite()
    for batch in fine[good:]:
        expected, figures = other.update(batch, 0.0), one.update(batch, 0.0)
        for name in ("policy_loss", "value_loss", "entropy"):
            assert figures[name] == pytest.approx(expected[name], rel=1e-3, abs=1e-5), name


@pytest.mark.parametrize("device", ["cpu", ON_GPU])
def test_target_kl_ends_the_policy_and_not_the_value_network(trainer, device) -> None:
    for dense in (False, True):
        ppo = trainer(device, dense=dense, epochs=4, target_kl=1e-9, actor_learning_rate=1e-2)
        (batch,) = batches(ppo, 1)
        ppo.update(batch, 0.0)
        policy, value = (
            int(optimizer.state[optimizer.parameters[0]]["step"])
            for optimizer in (ppo.policy_optimizer, ppo.value_optimizer)
        )
        assert policy < value == 4 * 3


@pytest.mark.parametrize("device", ["cpu", ON_GPU])
def test_a_checkpoint_moves_between_devices(trainer, device, tmp_path: Path) -> None:
    dense, sparse = trainer(device, dense=True), trainer()
    first, second = batches(dense, 2)
    dense.update(first, 0.0)
    path = save_checkpoint(tmp_path, dense, Counters(steps=48), {}, 1)
    load_checkpoint(path, sparse)
    again = trainer(device, dense=True)
    load_checkpoint(path, again)
    expected = dense.update(second, 0.5)
    for other, tolerance in ((again, 1e-5), (sparse, 1e-3)):
        figures = other.update(second, 0.5)
        for name in ("policy_loss", "value_loss", "learning_rate"):
            assert figures[name] == pytest.approx(expected[name], rel=tolerance, abs=1e-6), name


class Operations(TorchDispatchMode):
    """Names of all operations that run inside."""

    def __init__(self) -> None:
        super().__init__()
        self.names: set[str] = set()

    def __torch_dispatch__(self, operation, types, args=(), kwargs=None):
        self.names.add(operation.overloadpacket.__name__)
        return operation(*args, **(kwargs or {}))


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
def test_a_step_never_waits_for_the_device(
    trainer, precision: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Operations whose result the host reads, or whose size depends on data, break a graph."""
    # Torch's operations throughout, as on a device: the CPU has kernels for scans.
    monkeypatch.setattr(torch.compiler, "is_exporting", lambda: True)
    ppo = trainer(dense=True, learner={"precision": precision}, dual_clip=3.0)
    (batch,) = batches(ppo, 1)
    ppo.update(batch, 0.0)
    with Operations() as operations:
        for trainee in (ppo._actor, ppo._critic):
            trainee.step(None, torch.arange(16))
    assert {"scatter_reduce_", "convolution_backward", "_fused_adam_"} <= operations.names
    reading = {"_local_scalar_dense", "is_nonzero", "equal", "item"}
    sizing = {"nonzero", "masked_select", "unique_dim", "_unique2", "index", "lift_fresh"}
    assert not operations.names & (reading | sizing)


class Stream:
    """Stands in for a CUDA stream; remembers who waited for whom."""

    log: ClassVar[list[str]] = []

    def __init__(self, name: str) -> None:
        self.name = name

    def wait_stream(self, other: Stream) -> None:
        self.log.append(f"{self.name} after {other.name}")


def test_streams_start_after_the_upload_and_end_before_the_next(trainer, monkeypatch) -> None:
    current = [Stream("main")]

    @contextmanager
    def on(stream: Stream):
        current.append(stream)
        yield
        current.pop()

    monkeypatch.setattr(torch.cuda, "stream", on)
    monkeypatch.setattr(torch.cuda, "current_stream", lambda device: current[-1])
    ppo = trainer(dense=True)
    ppo._actor.stream, ppo._critic.stream = Stream("policy"), Stream("value")
    steps: list[str] = []
    for trainee in (ppo._actor, ppo._critic):

        def step(*arguments, work=trainee._whole_step) -> None:
            steps.append(current[-1].name)
            work(*arguments)

        monkeypatch.setattr(trainee, "_whole_step", step)
    monkeypatch.setattr(ppo.samples, "load", partial(_logged, ppo.samples.load, "load"))
    monkeypatch.setattr(ppo.samples, "set_goals", partial(_logged, ppo.samples.set_goals, "goals"))
    Stream.log.clear()
    (batch,) = batches(ppo, 1)
    ppo.update(batch, 0.0)
    around = ["policy after main", "value after main", "main after policy", "main after value"]
    assert Stream.log == ["load", *around, "goals", *around]
    assert steps == ["policy", "value"] * (2 * 3)


def _logged(call, name: str, *arguments):
    Stream.log.append(name)
    return call(*arguments)


def test_recording_asks_cuda_for_what_it_knows(monkeypatch) -> None:
    log: list[str | list[str]] = []

    class Graph:
        def replay(self) -> None:
            log.append("replay")

    real = inspect.signature(torch.cuda.graph.__init__)

    @contextmanager
    def capture(graph, **options):
        real.bind(None, graph, **options)
        log.append(sorted(options))
        yield

    monkeypatch.setattr(torch.cuda, "CUDAGraph", Graph)
    monkeypatch.setattr(torch.cuda, "graph", capture)
    stream = cast(torch.cuda.Stream, Stream("policy"))
    replay = record_cuda_graph(stream, lambda: log.append("work"))
    replay()
    assert log == [["capture_error_mode", "stream"], "work", "replay"]


@pytest.mark.cuda
def test_bfloat16_on_a_gpu_learns_about_the_same(trainer) -> None:
    figures = {}
    for precision in ("float32", "auto"):
        ppo = trainer("cuda", learner={"precision": precision}, epochs=4)
        for batch in batches(ppo, 3, RolloutStore(pinned=True)):
            figures[precision] = ppo.update(batch, 0.0)
    for name in ("value_loss", "entropy"):
        assert figures["auto"][name] == pytest.approx(figures["float32"][name], rel=0.05)
