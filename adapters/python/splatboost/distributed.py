# SPDX-License-Identifier: Apache-2.0
"""Decisions of one run in several processes of torch.distributed, independent of the number of processes.

Views are divided: each is rendered by one process, its owner. Gaussians may be sharded too: each process holds some
rows. Every process makes every decision from identical data: images and integer counts come from the view's owner,
statistics are integer sums, rows are ordered by id, and random draws depend on ids. Floating-point sums over processes
are avoided, because their rounding depends on the number of processes.
"""

from __future__ import annotations

from typing import Any, Callable, List, Optional, Sequence, Tuple

import torch
import torch.distributed as dist

from ._tensors import Place, counts_of
from .adapter import Adapter, ScoredView
from .operations import as_bytes, spare_one

#: Values are summed as integer multiples of 2^-40: exact in any order, for gradients that sum to at most 8e6.
_UNIT = 2.0**-40


class Processes:
    """The processes of a run; a single one if torch.distributed is not initialized."""

    def __init__(self, group: Any = None):
        self.group = group
        there = dist.is_available() and dist.is_initialized()
        self.rank = dist.get_rank(group) if there else 0
        self.count = dist.get_world_size(group) if there else 1

    def owner_of_view(self, view: int) -> int:
        """Rank of the process that renders a training view."""
        return view % self.count

    def from_owner(self, tensor: torch.Tensor, owner: int) -> torch.Tensor:
        """Broadcasts the owner's tensor, in place."""
        if self.count > 1:
            source = owner if self.group is None else dist.get_global_rank(self.group, owner)
            dist.broadcast(tensor, source, group=self.group)
        return tensor

    def in_owner(self, owner: int, what: str, work: Callable[[], Any], device: Any) -> Any:
        """work() in the owner, None elsewhere. If it fails, all processes raise: the others would wait for ever for what
        the owner broadcasts next. what: names the work in the error of the others."""
        done: Any = None
        error: Optional[BaseException] = None
        if self.rank == owner:
            try:
                done = work()
            except BaseException as e:  # KeyboardInterrupt too
                error = e
        failed = torch.tensor([error is not None], dtype=torch.int64, device=device)
        if self.from_owner(failed, owner).item():
            if error is not None:
                raise error
            raise RuntimeError("%s failed in process %d, whose own error tells why" % (what, owner))
        return done

    def sum(self, integers: torch.Tensor) -> torch.Tensor:
        """Sums an int64 tensor over processes, in place."""
        if integers.dtype != torch.int64:
            raise ValueError("integers: expected int64, got %s: other sums depend on the number of processes" % integers.dtype)
        if self.count > 1:
            dist.all_reduce(integers, group=self.group)
        return integers

    def rows(self, tensor: torch.Tensor) -> torch.Tensor:
        """Concatenates the rows of all processes, in rank order; their numbers may differ, and may be 0."""
        if self.count == 1:
            return tensor
        if tensor.dtype == torch.bool:  # gloo does not support bool
            return self.rows(tensor.to(torch.uint8)).bool()
        sizes = torch.zeros(self.count, dtype=torch.int64, device=tensor.device)
        sizes[self.rank] = tensor.shape[0]
        lengths = self.sum(sizes).tolist()
        if max(lengths) == 0:
            return tensor
        padded = tensor.new_zeros((max(lengths),) + tuple(tensor.shape[1:]))
        padded[: tensor.shape[0]] = tensor
        found = [torch.empty_like(padded) for _ in lengths]
        dist.all_gather(found, padded, group=self.group)
        return torch.cat([rows[:length] for rows, length in zip(found, lengths)])


class ExactSum:
    """Per-row sums over views, independent of how the views are divided. values: float32 [N], up to a few thousand."""

    def __init__(self, rows: int, device: Any = "cpu"):
        self._units = torch.zeros(rows, dtype=torch.int64, device=device)

    def add(self, values: torch.Tensor) -> None:
        self._units += torch.round(values.double() / _UNIT).to(torch.int64)

    def total(self, processes: Processes) -> torch.Tensor:
        """float64 [N] sums over the views of all processes."""
        return processes.sum(self._units.clone()).double() * _UNIT


class Shard:
    """The rows that this process holds, of Gaussians with ids; ids never change and are never reused.

    rows: total number in all processes at the start. They are divided evenly, in order; `mine` are the indices of this
    process's rows. device: that of the Gaussians; with NCCL a GPU.
    """

    def __init__(self, rows: int, processes: Optional[Processes] = None, device: Any = "cpu"):
        self.processes = processes or Processes()
        first = [rows * r // self.processes.count for r in range(self.processes.count + 1)]
        self.mine = slice(first[self.processes.rank], first[self.processes.rank + 1])
        self.ids = torch.arange(rows, dtype=torch.int64, device=device)[self.mine]
        self._next = rows

    @classmethod
    def dealt(cls, rows_here: int, processes: Optional[Processes] = None, device: Any = "cpu") -> "Shard":
        """For rows distributed round-robin, as tensor[rank::count]: local row i is row i · count + rank of all."""
        shard = cls(0, processes, device)
        count, rank = shard.processes.count, shard.processes.rank
        shard.mine = slice(rank, None, count)
        shard.ids = torch.arange(rows_here, dtype=torch.int64, device=device) * count + rank
        shard._next = int(shard.processes.sum(torch.tensor([rows_here], dtype=torch.int64, device=device)))
        return shard

    def all_rows(self, tensor: torch.Tensor) -> torch.Tensor:
        """Rows of all processes in the order of their ids."""
        _, order = torch.sort(self.processes.rows(self.ids))
        return self.processes.rows(tensor)[order]

    def own_rows(self, tensor: torch.Tensor) -> torch.Tensor:
        """The rows held here, from a tensor with all rows in the order of their ids."""
        everyone, _ = torch.sort(self.processes.rows(self.ids))
        return tensor[torch.searchsorted(everyone, self.ids)]

    def grow(self, clone: torch.Tensor, split: torch.Tensor, children: int = 2) -> torch.Tensor:
        """Records growth. Rows are then ordered as in 3DGS: those not split, clones, the first children of all splits,
        their second children, … clone, split: bool masks of the rows held here. Returns int64, for each row now: the id
        of the row that it was or was made from."""
        parts, origins = [self.ids[~split]], [self.ids[~split]]
        for mask in [clone] + [split] * children:
            parents, _ = torch.sort(self.processes.rows(self.ids[mask]))
            parts.append(self._next + torch.searchsorted(parents, self.ids[mask]))
            origins.append(self.ids[mask])
            self._next += parents.shape[0]
        self.ids = torch.cat(parts)
        return torch.cat(origins)

    def remove(self, mask: torch.Tensor) -> None:
        """Records the removal of rows. mask: bool, of the rows held here."""
        self.ids = self.ids[~mask]

    def normal(self, seed: int, iteration: int, columns: int) -> torch.Tensor:
        """float32 [rows, columns]: standard normal draws for the rows held here. Each depends only on seed, iteration,
        the row's id and the column, so that a Gaussian's children are the same whichever process splits it."""
        column = torch.arange(2 * columns, dtype=torch.int64, device=self.ids.device)
        start = (seed * 1_000_003 + iteration + 2**63) % 2**64 - 2**63  # modulo 2^64: seeds may have 64 bits
        key = _mixed(torch.tensor(start, dtype=torch.int64, device=self.ids.device))
        bits = _mixed(_mixed(key + self.ids.unsqueeze(1)) + column)
        uniform = ((bits >> 11) & ((1 << 53) - 1)).double() * 2.0**-53
        radius = torch.sqrt(-2 * torch.log1p(-uniform[:, :columns]))
        return (radius * torch.cos(2 * torch.pi * uniform[:, columns:])).float()


def _mixed(x: torch.Tensor) -> torch.Tensor:
    """SplitMix64 (Steele, Lea, Flood 2014): hashes int64 to 64 pseudorandom bits."""
    x = x + -7046029254386353131
    x = (x ^ ((x >> 30) & ((1 << 34) - 1))) * -4658895280553007687
    x = (x ^ ((x >> 27) & ((1 << 37) - 1))) * -7723592293110705685
    return x ^ ((x >> 31) & ((1 << 33) - 1))


class _FromOwner:
    """Counts and weights of a view that one process rendered, broadcast to all. render: None except in the owner."""

    def __init__(self, processes: Processes, owner: int, view: int, render: Any):
        self._processes, self._owner, self._view, self._render = processes, owner, view, render

    def _add_counts(self, flagged: Any, counts: Any, place: Place) -> None:
        def count(here: torch.Tensor) -> None:
            self._render._add_counts(flagged, place.target(here, "counts"), place)

        self._add(counts_of(counts, place), "counting flagged pixels", count)

    def _add_weights(self, weights: Any, place: Place) -> None:
        def weigh(here: torch.Tensor) -> None:
            self._render._add_weights(place.target(here, "weights"), place)

        self._add(counts_of(weights, place), "summing blending weights", weigh)

    def _add(self, sums: torch.Tensor, what: str, fill: Callable[[torch.Tensor], None]) -> None:
        here = torch.zeros_like(sums)
        self._processes.in_owner(self._owner, "%s of view %d" % (what, self._view), lambda: fill(here), here.device)
        sums += self._processes.from_owner(here, self._owner)


def shared_views(views: Sequence[Callable[[], ScoredView]], processes: Processes, device: Any) -> List[Callable[[], ScoredView]]:
    """Views for an Adapter that every process runs: each is rendered by its owner and broadcast to the others.

    views[j] is called only in its owner (owner_of_view), and may be anything elsewhere. If the Gaussians are sharded,
    it must render all of them, in the order of their ids. If a view fails in its owner, all processes raise.
    """

    def blank(height: int, width: int, masked: bool) -> ScoredView:
        def image(shape: Tuple[int, ...], dtype: torch.dtype) -> torch.Tensor:
            return torch.zeros(shape, dtype=dtype, device=device)

        color, truth = image((3, height, width), torch.float32), image((3, height, width), torch.uint8)
        return ScoredView(color, truth, image((height, width), torch.uint8) if masked else None)

    def drawn(j: int) -> ScoredView:
        """The view as it is broadcast: complete before the others wait for its images."""
        given = views[j]()
        height, width = given.color.shape[1:]
        view = blank(height, width, given.valid is not None)
        view.color.copy_(given.color)
        view.truth.copy_(as_bytes(given.truth))
        if view.valid is not None and given.valid is not None:
            view.valid.copy_(given.valid)
        view.render = given.render
        if view.render is None:
            from .compat import last_render

            view.render = last_render()
        return view

    def source(j: int) -> Callable[[], ScoredView]:
        def draw() -> ScoredView:
            owner = processes.owner_of_view(j)
            view: Optional[ScoredView] = processes.in_owner(owner, "rendering view %d" % j, lambda: drawn(j), device)
            form = torch.zeros(3, dtype=torch.int64, device=device)
            if view is not None:
                form[:] = torch.tensor([*view.color.shape[1:], view.valid is not None])
            height, width, masked = processes.from_owner(form, owner).tolist()
            if view is None:
                view = blank(height, width, bool(masked))
            for image in (view.color, view.truth, view.valid):
                if image is not None:
                    processes.from_owner(image, owner)
            view.render = _FromOwner(processes, owner, j, view.render)
            return view

        return draw

    return [source(j) for j in range(len(views))]


class SharedAdapter:
    """An Adapter whose decisions equal those of a single process that holds everything.

    adapter       must have the same settings and seed in every process
    shard         the rows held here; None: every process holds all Gaussians
    max_gaussians cap on the number of Gaussians after growth, over all processes; 0: no cap
    """

    def __init__(self, adapter: Adapter, shard: Optional[Shard] = None, processes: Optional[Processes] = None,
                 max_gaussians: int = 0):
        self.adapter = adapter
        self.shard = shard
        self.processes = shard.processes if shard is not None else processes or Processes()
        self.max_gaussians = max_gaussians
        self._before: Optional[torch.Tensor] = None  # ids before growth, in order

    def _all(self, tensor: Optional[torch.Tensor]) -> Any:
        if tensor is None or self.shard is None:
            return tensor
        return self.shard.all_rows(tensor)

    def _own(self, tensor: torch.Tensor) -> torch.Tensor:
        return tensor if self.shard is None else self.shard.own_rows(tensor)

    def grow(self, iteration: int, views: Sequence[Callable[[], ScoredView]], *, scene_extent: float,
             gradients: torch.Tensor, gradients_abs: Optional[torch.Tensor] = None,
             max_scales: Optional[torch.Tensor] = None, clone: Optional[torch.Tensor] = None,
             split: Optional[torch.Tensor] = None) -> Tuple[torch.Tensor, torch.Tensor]:
        """As Adapter.grow, for the rows held here; statistics are means over the views of all processes (ExactSum)."""
        every = self._all(gradients)
        grows, splits = self.adapter.grow(
            iteration, shared_views(views, self.processes, self.adapter.device), scene_extent=scene_extent,
            gradients=every, gradients_abs=self._all(gradients_abs), max_scales=self._all(max_scales),
            clone=self._all(clone), split=self._all(split), max_primitives=self.max_gaussians)
        if self.shard is not None:
            self._before, _ = torch.sort(self.processes.rows(self.shard.ids))
        return self._own(grows), self._own(splits)

    def prune(self, iteration: int, views: Sequence[Callable[[], ScoredView]], *, candidates: torch.Tensor,
              opacities: torch.Tensor, origins: Optional[torch.Tensor] = None,
              clearances: Optional[torch.Tensor] = None) -> torch.Tensor:
        """As Adapter.prune, for the rows held here; at least one row over all processes is kept. origins: with a shard,
        as returned by its grow()."""
        if origins is not None and self.shard is not None:
            assert self._before is not None
            origins = torch.searchsorted(self._before, self._all(origins))
        every = self._all(opacities)
        remove = self.adapter.prune(iteration, shared_views(views, self.processes, self.adapter.device),
                                    candidates=self._all(candidates), opacities=every, origins=origins,
                                    clearances=None if clearances is None else self._all(clearances),
                                    max_primitives=self.max_gaussians)
        return self._own(spare_one(every.reshape(-1), remove))
