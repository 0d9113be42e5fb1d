# SPDX-License-Identifier: Apache-2.0
"""Averages at the end of a patched host's run."""

import types

import pytest
import torch
from test_hooks import Adapter, Model, boost_of

from splatboost.hooks import _boost, deformable_3dgs, pgsr, vanilla


def end_of_run(kind, removes=False, sets=False, **state):
    """The values after each of the last steps of a run, in which averages begin after the third. After the fourth, the host
    removes a Gaussian, or sets the parameters, as for an opacity reset."""
    boost = boost_of(kind, adapter=Adapter(remove=[1]), **state)
    model, values = boost.gaussians, []
    for iteration in range(93, 100):  # the host takes no step in its last iteration, 100
        boost.begin(iteration)
        (model.value * iteration).sum().backward()
        boost.optimizer.step()
        values.append(model.value.detach().clone())
        if removes and iteration == 96:
            boost.prune_late()
        if sets and iteration == 96:
            model.value = torch.nn.Parameter(model.value.detach() + 7)
        model.optimizer.param_groups[0]["params"] = [model.value]
    return values


@pytest.mark.parametrize("kind, averages", [(vanilla, True), (pgsr, True), (deformable_3dgs, False)])
def test_a_run_ends_with_the_means_of_its_last_parameters(kind, averages):
    steps = end_of_run(kind, averages=False)
    expected = torch.stack([steps[2], steps[4], steps[6]]).mean(0) if averages else steps[-1]
    found = end_of_run(kind)[-1]
    assert torch.allclose(found, expected, atol=1e-6)
    assert torch.equal(found, steps[-1]) != averages


@pytest.mark.parametrize("change", [{"removes": True}, {"sets": True}])
def test_means_begin_again_when_the_host_replaces_parameters(change):
    steps = end_of_run(vanilla, averages=False, **change)
    assert torch.allclose(end_of_run(vanilla, **change)[-1], torch.stack([steps[4], steps[6]]).mean(0), atol=1e-6)


def test_a_run_goes_on_without_means_if_memory_runs_out(monkeypatch):
    def fails(*given):
        raise _boost._OUT_OF_MEMORY("no memory")

    monkeypatch.setattr(torch, "zeros_like", fails)
    averages = _boost.Averages()
    averages.add(Model().optimizer)
    monkeypatch.undo()
    model = Model()
    before = model.value.detach().clone()
    averages.take()
    averages.add(model.optimizer)  # there is memory again
    averages.take()
    assert torch.equal(model.value.detach(), before)


def test_means_are_not_kept_if_a_gpu_has_no_memory_for_them_at_its_peak(monkeypatch):
    model = Model()
    before = model.value.detach().clone()
    monkeypatch.setattr(_boost, "_fits", lambda parameters: False)
    averages = _boost.Averages()
    averages.add(model.optimizer)
    with torch.no_grad():
        model.value += 1
    averages.add(model.optimizer)
    averages.take()
    assert torch.equal(model.value.detach(), before + 1)


@pytest.mark.parametrize("free, fits", [(30, False), (55, True)])
def test_memory_for_means_is_what_the_peak_leaves(monkeypatch, free, fits):
    """Here 10 of the 30 bytes that torch holds were not needed at the peak of the run: 40 or 65 bytes for 48, with a reserve."""
    monkeypatch.setattr(torch.cuda, "mem_get_info", lambda device: (free, 1000))
    monkeypatch.setattr(torch.cuda, "memory_reserved", lambda device: 30)
    monkeypatch.setattr(torch.cuda, "max_memory_allocated", lambda device: 20)
    on_gpu = types.SimpleNamespace(is_cuda=True, device=torch.device("cuda:0"), numel=lambda: 6, element_size=lambda: 4)
    assert _boost._fits([on_gpu, on_gpu]) == fits
    assert _boost._fits([torch.zeros(100)])
