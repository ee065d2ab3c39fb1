"""Acting: the policy's evaluation without gradients, with and without torch, and on a GPU."""

from lndrl.policy.acting.runner import (
    LocalPolicy,
    PolicyRunner,
    act_on_one_thread,
    load_engine,
    local_policy,
)

__all__ = ["LocalPolicy", "PolicyRunner", "act_on_one_thread", "load_engine", "local_policy"]
