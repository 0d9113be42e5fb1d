# SPDX-License-Identifier: Apache-2.0
"""Converts torch tensors to tensors of the C ABI, with checks that name the argument."""

from __future__ import annotations

import ctypes
from typing import Any, List, Optional, Sequence, Union

import torch

from . import _library as lib

_TYPES = {
    torch.float32: lib.FLOAT32,
    torch.float64: lib.FLOAT64,
    torch.int32: lib.INT32,
    torch.int64: lib.INT64,
    torch.uint8: lib.UINT8,
    torch.bool: lib.UINT8,  # a byte of 0 or 1
}

#: torch device type → device kind of the library.
_KINDS = {"cpu": lib.CPU, "cuda": lib.CUDA}

Size = Union[int, str]  # a number, or a name for an arbitrary size


def check(tensor: Any, name: str, dtype: Union[torch.dtype, Sequence[torch.dtype]], *shapes: Sequence[Size]) -> None:
    """Raises ValueError unless the tensor has the type, or one of the types, and one of the shapes; a name in a shape
    fits any size."""
    dtypes = (dtype,) if isinstance(dtype, torch.dtype) else dtype
    if not isinstance(tensor, torch.Tensor):
        raise ValueError("%s: expected a tensor, got %s" % (name, type(tensor).__name__))
    if tensor.dtype not in dtypes:
        raise ValueError("%s: expected %s, got %s" % (name, " or ".join(map(_name, dtypes)), _name(tensor.dtype)))
    for shape in shapes:
        if len(shape) == tensor.dim() and all(isinstance(w, str) or w == s for w, s in zip(shape, tensor.shape)):
            return
    wanted = " or ".join("[" + ",".join(str(s) for s in shape) + "]" for shape in shapes)
    raise ValueError("%s: expected shape %s, got %s" % (name, wanted, list(tensor.shape)))


def _name(dtype: torch.dtype) -> str:
    return str(dtype).replace("torch.", "")


class Place:
    """Where a call runs: on the device of its first tensor and torch's current stream there. Makes views of further
    tensors, which must be on the same device. The library itself sets the current CUDA device during a call.
    """

    def __init__(self, tensor: Any, name: str):
        if not isinstance(tensor, torch.Tensor):
            raise ValueError("%s: expected a tensor, got %s" % (name, type(tensor).__name__))
        self.device: torch.device = tensor.device
        self._first = name
        self._keep: List[Any] = []
        if self.device.type not in _KINDS:
            raise ValueError("%s: expected a tensor on the CPU or on CUDA, got one on %s" % (name, self.device))
        self.kind = _KINDS[self.device.type]
        self.index = int(self.device.index or 0) if self.kind == lib.CUDA else 0
        if self.kind == lib.CUDA and not lib.cuda_architectures():
            raise lib.NoCudaError(
                "%s is on %s, but this libsplatboost was built without CUDA: move the tensors to the CPU, or %s"
                % (name, self.device, lib.CUDA_REMEDY)
            )

    @property
    def threads(self) -> int:
        return lib.get_threads() if self.kind == lib.CPU else 0

    @property
    def stream(self) -> Optional[int]:
        """The current CUDA stream; None on the CPU."""
        return torch.cuda.current_stream(self.device).cuda_stream if self.kind == lib.CUDA else None

    def c_device(self) -> Any:
        return ctypes.byref(lib.Device(self.kind, self.index, self.threads, self.stream))

    def call(self, entry: str, *arguments: Any) -> None:
        """Calls an entry; on a GPU, frees torch's cached memory and retries once if memory runs out."""
        try:
            lib.call(entry, *arguments)
        except MemoryError:
            if self.kind != lib.CUDA:
                raise
            torch.cuda.empty_cache()  # torch's cached memory may be enough
            lib.call(entry, *arguments)

    def check_here(self, tensor: torch.Tensor, name: str) -> None:
        if tensor.device != self.device:
            raise ValueError(
                "%s: expected a tensor on %s (as %s), got one on %s" % (name, self.device, self._first, tensor.device)
            )

    def view(
        self, tensor: Optional[torch.Tensor], name: str, dtype: Optional[torch.dtype] = None, *shapes: Sequence[Size]
    ) -> Any:
        """Pointer to a view of an input tensor; None for None. A tensor that is not contiguous is copied.

        The view is valid as long as this place exists.
        """
        if tensor is None:
            return None
        if dtype is not None:
            check(tensor, name, dtype, *shapes)
        self.check_here(tensor, name)
        dense = tensor.detach().contiguous()
        return self._pointer(dense)

    def target(self, tensor: Optional[torch.Tensor], name: str) -> Any:
        """Pointer to a view of an output tensor, which must be contiguous; None for None."""
        if tensor is None:
            return None
        self.check_here(tensor, name)
        if not tensor.is_contiguous():
            raise ValueError("%s: expected a contiguous tensor, got one with strides %s" % (name, list(tensor.stride())))
        return self._pointer(tensor.detach())

    def _pointer(self, dense: torch.Tensor) -> Any:
        t = lib.Tensor()
        t.data = dense.data_ptr() or None
        t.type = _TYPES[dense.dtype]
        t.dimensions = dense.dim()
        t.shape[: dense.dim()] = list(dense.shape)
        t.strides[: dense.dim()] = list(dense.stride())
        t.device_kind = self.kind
        t.device_index = self.index
        self._keep.append((dense, t))
        return ctypes.pointer(t)

    def empty(self, shape: Sequence[int], dtype: torch.dtype = torch.float32) -> torch.Tensor:
        return torch.empty(tuple(shape), dtype=dtype, device=self.device)


class _OnCuda:
    """GPU memory that torch can wrap without copying."""

    def __init__(self, address: int, count: int):
        self.__cuda_array_interface__ = {"data": (address, False), "shape": (count,), "typestr": "<i4", "version": 2}


def counts_of(pointer: Any, place: Place) -> torch.Tensor:
    """An int32 [N] tensor of the library, wrapped as a torch tensor without copying; valid as long as that memory."""
    view = pointer[0]
    count = int(view.shape[0])
    if count == 0:
        return torch.zeros(0, dtype=torch.int32, device=place.device)
    if place.device.type == "cuda":
        return torch.as_tensor(_OnCuda(view.data, count), device=place.device)
    return torch.frombuffer((ctypes.c_int32 * count).from_address(view.data), dtype=torch.int32)
