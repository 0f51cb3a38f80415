"""What processes that train together share: sums, and the matrices whose steps each works out.

A step of Muon costs a third of a step's arithmetic, so each process takes it for its part of the
matrices, and all get the result; equal weights and equal sums keep the processes equal.
"""

from collections.abc import Sequence
from typing import Any


def add_up(tensors: Sequence[Any], share: tuple[int, int]) -> None:
    """Replace tensors by their sums over the processes.

    Args:
        tensors: of equal shapes in every process.
        share: (rank, number) of this process.
    """
    import torch

    if share[1] == 1:
        return
    flat = torch.cat([value.flatten() for value in tensors])
    torch.distributed.all_reduce(flat)
    start = 0
    for value in tensors:
        value.copy_(flat[start : start + value.numel()].view_as(value))
        start += value.numel()


def matrices(optimizer: Any) -> list[Any]:
    """Return what an optimizer changes."""
    return [value for group in optimizer.param_groups for value in group["params"]]


def others(optimizer: Any, share: tuple[int, int]) -> list[Any]:
    """Return the matrices that other processes work out."""
    rank, number_of = share
    return [value for place, value in enumerate(matrices(optimizer)) if place % number_of != rank]


def share_moments(optimizer: Any, share: tuple[int, int]) -> None:
    """Give every process the momentum of every matrix, for a checkpoint."""
    import torch

    if share[1] == 1:
        return
    for value in others(optimizer, share):
        optimizer.state[value]["momentum_buffer"] = torch.zeros_like(value)
    add_up([optimizer.state[value]["momentum_buffer"] for value in matrices(optimizer)], share)
