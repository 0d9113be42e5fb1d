# SPDX-License-Identifier: Apache-2.0
"""CUDA tensors without a GPU: torch's CPU tensors stand in for them, and the library is the one built for the emulator,
whose device memory is the host's."""

import contextlib
import types

import torch

from splatboost import _library as lib
from splatboost import _tensors

#: The current stream reported by torch; any other number than 0 would have to be a stream of the emulator.
_STREAM = types.SimpleNamespace(cuda_stream=0)


@contextlib.contextmanager
def cuda():
    """Makes the package treat CPU tensors as CUDA tensors. It must have loaded the emulator's library."""
    kinds, stream = dict(_tensors._KINDS), torch.cuda.current_stream
    _tensors._KINDS["cpu"] = lib.CUDA
    torch.cuda.current_stream = lambda device=None: _STREAM
    try:
        yield
    finally:
        _tensors._KINDS.update(kinds)
        torch.cuda.current_stream = stream
