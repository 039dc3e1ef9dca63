"""Several processes that train one network together, as `torchrun` and `accelerate launch` start them."""

from __future__ import annotations

import atexit
import os
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import timedelta
from typing import TypeVar

import torch
from torch import Tensor, nn

_PATIENCE = timedelta(hours=2)  # how long the other processes wait while the first one validates and writes
_Value = TypeVar("_Value")


@dataclass(frozen=True)
class Ranks:
    """This process's rank and the number of processes. Only rank 0 validates, writes and reports progress."""

    rank: int = 0
    count: int = 1

    @property
    def first(self) -> bool:
        return self.rank == 0

    def sum_gradients(self, parameters: Sequence[nn.Parameter], numbers: Tensor) -> Tensor:
        """Sum the processes' gradients in place and return the sums of `numbers`, all in one message.

        A parameter that has no gradient in any process keeps none.
        """
        if self.count == 1:
            return numbers
        present = [float(each.grad is not None) for each in parameters]
        pieces = [
            (torch.zeros_like(each) if each.grad is None else each.grad).flatten().float() for each in parameters
        ]
        whole = torch.cat([*pieces, torch.tensor(present, device=numbers.device), numbers.float()])
        torch.distributed.all_reduce(whole)
        *sums, anywhere, totals = whole.split([*(each.numel() for each in parameters), len(present), len(numbers)])
        for parameter, total, seen in zip(parameters, sums, anywhere.tolist(), strict=True):
            parameter.grad = total.view_as(parameter).to(parameter.dtype) if seen else None
        return totals

    def from_first(self, value: _Value) -> _Value:
        """The first process's value, in all processes; the others wait for it."""
        if self.count == 1:
            return value
        from accelerate.utils import broadcast_object_list

        return broadcast_object_list([value])[0]

    def copy_weights(self, networks: nn.Module) -> None:
        """Copy the first process's weights to all processes."""
        if self.count > 1:
            with torch.no_grad():
                for value in networks.state_dict().values():
                    torch.distributed.broadcast(value, 0)


def started_ranks() -> Ranks:
    """Rank and number of processes from the launcher's environment, without connecting to the others."""
    count = int(os.environ.get("WORLD_SIZE", 1))
    return Ranks(int(os.environ.get("RANK", 0)), count) if count > 1 else Ranks()


def join_ranks(device: torch.device) -> Ranks:
    """Connect to the launcher's other processes, if there are any. NCCL on GPUs, Gloo on CPUs."""
    if started_ranks().count == 1:
        return Ranks()
    from accelerate import PartialState

    state = PartialState(cpu=device.type == "cpu", timeout=_PATIENCE)
    atexit.register(state.destroy_process_group)
    return Ranks(state.process_index, state.num_processes)
