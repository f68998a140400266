"""The products of a sparse convolution: by the native library beside this file on a CPU, or by
PyTorch alone. Both give the same to rounding (training_test.py)."""

import ctypes
import os
import pathlib
import subprocess

import torch

LANES = 16


def load_library(build=True):
    """Builds the library for this processor if need be; none without a compiler."""
    here = pathlib.Path(__file__).parent
    source, library = here / "sparse_products.cpp", here / "build" / "libsparse_products.so"
    if not library.exists() or library.stat().st_mtime < source.stat().st_mtime:
        if not build:
            return None
        library.parent.mkdir(exist_ok=True)
        unfinished = library.with_suffix(f".{os.getpid()}")  # others may build it just now
        command = ["g++", "-std=c++17", "-O3", "-march=native", "-mprefer-vector-width=512",
                   "-fopenmp", "-shared", "-fPIC", str(source), "-o", str(unfinished)]
        try:
            subprocess.run(command, check=True)
            unfinished.replace(library)
        except (OSError, subprocess.CalledProcessError):
            return None
    return ctypes.CDLL(str(library))


library = load_library()


def native(tensor, *channels):
    return library is not None and tensor.device.type == "cpu" and not any(c % LANES for c in channels)


def pointer(tensor):
    return ctypes.c_void_p(tensor.data_ptr())


class Pairs:
    """(input, output) rows by kernel position, of a table [N_out, K]."""

    def __init__(self, table, n_in):
        table = table.contiguous()
        n_out, self.volume = table.shape
        self.first = torch.zeros(self.volume + 1, dtype=torch.int64)
        arguments = [pointer(table), ctypes.c_int64(n_out), self.volume, ctypes.c_int64(n_in),
                     pointer(self.first)]
        library.sparse_pairs(*arguments, None, None)
        count = int(self.first[-1])
        self.inputs = torch.empty(count, dtype=torch.int32)
        self.outputs = torch.empty(count, dtype=torch.int32)
        library.sparse_pairs(*arguments, pointer(self.inputs), pointer(self.outputs))


def multiply(features, weight, inputs, outputs, first, n_out):
    """[n_out, C_out]: sum over positions of features[inputs] @ weight[k]."""
    features, weight = features.contiguous(), weight.contiguous()
    volume, c_in, c_out = weight.shape
    result = torch.zeros(n_out, c_out)
    library.sparse_multiply(pointer(features), c_in, pointer(weight), c_out, pointer(inputs),
                            pointer(outputs), pointer(first), volume, ctypes.c_int64(n_out),
                            pointer(result))
    return result


def weight_gradient(features, gradient, pairs, shape):
    features, gradient = features.contiguous(), gradient.contiguous()
    result = torch.empty(shape)
    library.sparse_weight_gradient(pointer(features), shape[1], pointer(gradient), shape[2],
                                   pointer(pairs.inputs), pointer(pairs.outputs),
                                   pointer(pairs.first), shape[0], pointer(result))
    return result
