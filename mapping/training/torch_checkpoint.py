"""Reads the tensors of a PyTorch checkpoint (.pth) without PyTorch and without running anything in it.

A checkpoint is a pickle, and a pickle is a program. torch.load(weights_only=True) is one answer; the one of Debian 12
(PyTorch 1.13) has a known hole (CVE-2025-32434), so the few opcodes' worth of meaning are given here: the
unpickler knows OrderedDict, tensors and storages, and whatever else a checkpoint names becomes an inert `Unknown`.
Both containers are read: the zip of PyTorch >= 1.6, and the older stream that OpenPCDet writes to this day.
"""

import collections
import io
import pickle
import struct
import zipfile

import numpy as np

STORAGES = {
    "DoubleStorage": np.dtype("<f8"),
    "FloatStorage": np.dtype("<f4"),
    "HalfStorage": np.dtype("<f2"),
    "LongStorage": np.dtype("<i8"),
    "IntStorage": np.dtype("<i4"),
    "ShortStorage": np.dtype("<i2"),
    "CharStorage": np.dtype("<i1"),
    "ByteStorage": np.dtype("<u1"),
    "BoolStorage": np.dtype("?"),
}
LEGACY_MAGIC = 0x1950A86A20F9469CFC6C
LEGACY_VERSION = 1001
# The largest published checkpoint with its optimizer is below 400 MB.
MAX_BYTES = 2 << 30


class CheckpointError(ValueError):
    """Names the file, what was found and what was expected."""


class Unknown(dict):
    """Stands for anything that is no tensor; takes all that a pickle does to an object and does nothing."""

    def __init__(self, *_args, **_keywords):
        super().__init__()

    def __setstate__(self, state):
        pass

    def append(self, value):
        pass

    def extend(self, values):
        pass


class _StorageType:
    """What the pickle calls torch.FloatStorage: a name for a dtype that cannot be called."""

    def __init__(self, dtype):
        self.dtype = dtype


class _Storage:
    def __init__(self, dtype, count):
        self.dtype = dtype
        self.count = count
        self.numbers = None  # filled after the pickle is read, since the older container has them behind it


class _Tensor:
    def __init__(self, storage, offset, shape, strides):
        if not isinstance(storage, _Storage):
            raise CheckpointError("found a tensor of no storage")
        whole = [offset, *shape, *strides]
        if len(shape) != len(strides) or not all(type(value) is int and value >= 0 for value in whole):
            raise CheckpointError(f"found a tensor of shape {shape!r:.60}, strides {strides!r:.60}")
        last = offset + sum((size - 1) * stride for size, stride in zip(shape, strides))
        if 0 not in shape and last >= storage.count:
            raise CheckpointError(f"found a tensor that ends at number {last} of a storage of {storage.count}")
        self.storage, self.offset, self.shape, self.strides = storage, offset, tuple(shape), tuple(strides)

    def array(self):
        if 0 in self.shape:
            return np.zeros(self.shape, self.storage.dtype)
        strides = [stride * self.storage.dtype.itemsize for stride in self.strides]
        view = np.lib.stride_tricks.as_strided(self.storage.numbers[self.offset :], self.shape, strides)
        # Strides of 0 make a small storage a huge tensor.
        if view.size > max(self.storage.count, 1):
            raise CheckpointError(f"found a tensor of {view.size} numbers in a storage of {self.storage.count}")
        return np.array(view)


def _rebuild_tensor(storage, offset, shape, strides, *_rest):
    return _Tensor(storage, offset, shape, strides)


def _rebuild_parameter(tensor, *_rest):
    return tensor


class _Unpickler(pickle.Unpickler):
    def __init__(self, stream, storages):
        super().__init__(stream)
        self.storages = storages

    def find_class(self, module, name):
        if (module, name) == ("collections", "OrderedDict"):
            return collections.OrderedDict
        if (module, name) in (("torch._utils", "_rebuild_tensor_v2"), ("torch._utils", "_rebuild_tensor")):
            return _rebuild_tensor
        if (module, name) == ("torch._utils", "_rebuild_parameter"):
            return _rebuild_parameter
        if module == "torch" and name in STORAGES:
            return _StorageType(STORAGES[name])
        return Unknown

    def persistent_load(self, key):
        if not (isinstance(key, tuple) and len(key) >= 5 and key[0] == "storage"):
            return Unknown()  # ("module", ...) of whole pickled models
        _, kind, name, _, count = key[:5]
        if len(key) == 6 and key[5] is not None:
            raise CheckpointError("found a view of a storage, expected whole storages")
        if not isinstance(kind, _StorageType):
            raise CheckpointError(f"found a storage of a type that is not read, expected one of {', '.join(STORAGES)}")
        if type(count) is not int or not 0 <= count <= MAX_BYTES or type(name) is not str:
            raise CheckpointError(f"found a storage of {count!r:.60} numbers")
        storage = self.storages.setdefault(name, _Storage(kind.dtype, count))
        if (storage.dtype, storage.count) != (kind.dtype, count):
            raise CheckpointError(f"found storage {name:.60} with two sizes or types")
        return storage


def load_state_dict(path):
    """@return {name: numpy array} of the checkpoint's "model_state" (or of the file, when it is a bare state dict).

    Whatever stands beside it (optimizer, epoch) is left alone. @throws CheckpointError.
    """
    try:
        with open(path, "rb") as stream:
            content = _load_zip(stream) if zipfile.is_zipfile(stream) else _load_stream(stream)
        state = content.get("model_state", content) if isinstance(content, dict) else content
        if not isinstance(state, dict) or isinstance(state, Unknown) or not state:
            raise CheckpointError('found no state dict, expected one as "model_state" or as the whole file')
        for name, value in state.items():
            if not isinstance(name, str) or not isinstance(value, _Tensor):
                raise CheckpointError(f"found {name!r:.60} that is no tensor, expected tensors by name")
        return {name: value.array() for name, value in state.items()}
    except CheckpointError as error:
        raise CheckpointError(f"{path}: {error}") from error
    except OSError:
        raise
    except Exception as error:  # whatever a broken pickle makes Python raise
        raise CheckpointError(f"{path}: found {type(error).__name__} ({error}), expected a PyTorch checkpoint") from error


def _fill(storage, data):
    if len(data) != storage.count * storage.dtype.itemsize:
        raise CheckpointError(f"found a storage of {len(data)} bytes, expected {storage.count} numbers of "
                              f"{storage.dtype}")
    storage.numbers = np.frombuffer(data, storage.dtype)


def _load_zip(stream):
    with zipfile.ZipFile(stream) as archive:
        if sum(entry.file_size for entry in archive.infolist()) > MAX_BYTES:
            raise CheckpointError(f"found more than {MAX_BYTES} bytes")
        pickles = [name for name in archive.namelist() if name.endswith("/data.pkl")]
        if len(pickles) != 1:
            raise CheckpointError(f"found {len(pickles)} data.pkl, expected one")
        folder = pickles[0][: -len("data.pkl")]
        order = folder + "byteorder"
        if order in archive.namelist() and archive.read(order) != b"little":
            raise CheckpointError("found big-endian numbers, expected little-endian")
        storages = {}
        content = _Unpickler(io.BytesIO(archive.read(pickles[0])), storages).load()
        for name, storage in storages.items():
            _fill(storage, archive.read(f"{folder}data/{name}"))
        return content


def _load_stream(stream):
    stream.seek(0, io.SEEK_END)
    if stream.tell() > MAX_BYTES:
        raise CheckpointError(f"found more than {MAX_BYTES} bytes")
    stream.seek(0)
    storages = {}

    def load():
        return _Unpickler(stream, storages).load()

    if load() != LEGACY_MAGIC or load() != LEGACY_VERSION:
        raise CheckpointError("found another file, expected a PyTorch checkpoint")
    system = load()
    if not isinstance(system, dict) or system.get("little_endian") is not True:
        raise CheckpointError("found big-endian numbers, expected little-endian")
    content = load()
    for name in load():
        (count,) = struct.unpack("<q", stream.read(8))
        storage = storages.get(name)
        if storage is None or count != storage.count:
            raise CheckpointError(f"found storage {name!r:.60} of {count}, expected those of the pickle")
        _fill(storage, stream.read(count * storage.dtype.itemsize))
    if any(storage.numbers is None for storage in storages.values()):
        raise CheckpointError("found a pickle that names storages which are not there")
    return content
