#!/usr/bin/env python3
"""Makes weights.safetensors and layers.safetensors beside it; see README.md.

usage: make.py [--check]      --check writes nothing and says where the committed files differ; exit code 77 without
torch, numpy or yaml.
"""

import json
import pathlib
import sys

try:
    import numpy as np
    import torch
    import yaml  # noqa: F401  the converter needs it
except ImportError as error:
    print(f"skipped: {error} (Debian: python3-torch libopenblas0-pthread python3-numpy python3-yaml)")
    sys.exit(77)

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parents[2] / "mapping/training"), str(HERE)]
import openpcdet
import openpcdet_network as network
import safetensors

LAYOUTS = ("spconv 1", "spconv 2, native", "spconv 2")


def weights(state):
    config = openpcdet.config_of(network.YAML, "openpcdet-tiny")
    tensors = openpcdet.converted(state, config)
    for layout in LAYOUTS:
        other = openpcdet.converted(network.in_layout(state, layout), config)
        assert all(np.array_equal(tensors[name], other[name]) for name in tensors), layout
    metadata = {"format": "stillmap-voxelnext", "version": "1", "config": json.dumps(config)}
    return tensors, metadata


def layers(state):
    """Rows of each layer by its name; sites (z y x) once for each set of them."""
    sites, features = network.scene()
    tensors = {"voxels.rows": features, "voxels.sites": sites.astype(np.float16)}
    for name, layer in network.Network(state).run(sites, features).items():
        tensors[name + ".rows"] = layer.rows().astype(np.float32)
        if name == "input" or name.endswith(".down") or name in ("merge", "neck.out"):
            tensors[name + ".sites"] = layer.sites().astype(np.float16)  # whole numbers below 2048
    return tensors


def differences(name, made):
    """1e-5 of the truth's size lets another BLAS pass, and no mistake."""
    try:
        kept, _ = safetensors.load(HERE / name)
    except FileNotFoundError:
        return [f"{name} is not there"]
    faults = [f"{name}: {tensor} is in only one" for tensor in sorted(set(kept) ^ set(made))]
    for tensor in sorted(set(kept) & set(made)):
        a, b = kept[tensor].astype(np.float64), made[tensor].astype(np.float64)
        if a.shape != b.shape or not np.allclose(a, b, rtol=1e-5, atol=1e-5):
            faults.append(f"{name}: {tensor} differs")
    return faults


def main():
    torch.set_num_threads(1)
    state = network.state_dict()
    tensors, metadata = weights(state)
    truth = layers(state)
    if sys.argv[1:] == ["--check"]:
        faults = differences("weights.safetensors", tensors) + differences("layers.safetensors", truth)
        print("\n".join(faults) or f"{len(tensors) + len(truth)} tensors are as committed")
        return 1 if faults else 0
    if sys.argv[1:]:
        print(__doc__)
        return 2
    safetensors.save(HERE / "weights.safetensors", tensors, metadata)
    safetensors.save(HERE / "layers.safetensors", truth, {"made_by": "tests/data/voxelnext/make.py"})
    for name, tensor in sorted(truth.items()):
        if name.endswith(".rows"):
            print(f"{name:28} {str(tensor.shape):12} mean {tensor.mean():8.3f} largest {np.abs(tensor).max():8.3f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
