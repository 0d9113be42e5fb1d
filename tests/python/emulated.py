# SPDX-License-Identifier: Apache-2.0
"""CUDA tensors without a GPU: torch's CPU tensors pose as such, and the library is the one on the emulator, whose device
memory is the host's."""

import contextlib
import types

import torch

from splatboost import _library as lib
from splatboost import _tensors

#: What torch says its current stream is; any number but 0 would have to be one of the emulator's.
_STREAM = types.SimpleNamespace(cuda_stream=0)


@contextlib.contextmanager
def cuda():
    """Within it CPU tensors are CUDA's to the package, which must have loaded the emulator's library."""
    kinds, stream = dict(_tensors._KINDS), torch.cuda.current_stream
    _tensors._KINDS["cpu"] = lib.CUDA
    torch.cuda.current_stream = lambda device=None: _STREAM
    try:
        yield
    finally:
        _tensors._KINDS.update(kinds)
        torch.cuda.current_stream = stream
