"""Where networks compute, and in which numbers."""

from __future__ import annotations

import pytest
import torch

from stages.shared.networks.layers.device import computes_bfloat16

ASKED = ("_is_amx_tile_supported", "_is_avx512_bf16_supported")


@pytest.mark.parametrize(("amx", "avx512"), [(False, False), (True, False), (False, True), (True, True)])
def test_a_cpu_computes_in_bfloat16_where_it_has_instructions_for_its_products(monkeypatch, amx: bool, avx512: bool):
    for name, answer in zip(ASKED, (amx, avx512), strict=True):
        monkeypatch.setattr(torch.cpu, name, lambda answer=answer: answer, raising=False)
    assert computes_bfloat16(torch.device("cpu")) == (amx or avx512)


def test_a_torch_that_cannot_tell_computes_in_float32(monkeypatch):
    for name in ASKED:
        monkeypatch.delattr(torch.cpu, name, raising=False)
    assert not computes_bfloat16(torch.device("cpu"))
