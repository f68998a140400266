#!/usr/bin/env python3
"""Tests of the conversion from OpenPCDet and of its two file formats. Exit code 77 (skipped) without numpy or yaml.

That each layer gives out the same afterwards is shown by tests/data/voxelnext/make.py --check and the unit test of
the program on the files made there.
"""

import collections
import copy
import json
import os
import pathlib
import pickle
import struct
import subprocess
import sys
import tempfile
import unittest
import zipfile

try:
    import numpy as np
    import yaml
except ImportError as error:
    print(f"skipped: {error} (Debian: python3-numpy python3-yaml)")
    sys.exit(77)

HERE = pathlib.Path(__file__).resolve().parent
TINY = HERE.parents[1] / "tests/data/voxelnext"
sys.path[:0] = [str(HERE)]
import openpcdet
import safetensors
import torch_checkpoint

try:
    import torch

    sys.path.append(str(TINY))
    import openpcdet_network
except ImportError:
    torch = None
    print("skipped: what needs torch (Debian: python3-torch libopenblas0-pthread)")
needs_torch = unittest.skipUnless(torch, "torch is not installed")


class Folder(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)


class Safetensors(Folder):
    def tensors(self):
        return {"b": np.arange(6, dtype=np.float32).reshape(2, 3), "a": np.array([0.5, -2.0], np.float16),
                "none": np.zeros((0, 4), np.float32)}

    def test_gives_back_what_was_written(self):
        file = self.folder / "w.safetensors"
        safetensors.save(file, self.tensors(), {"k": "v"})
        read, metadata = safetensors.load(file)
        self.assertEqual(metadata, {"k": "v"})
        self.assertEqual(set(read), set(self.tensors()))
        for name, array in self.tensors().items():
            self.assertEqual(read[name].dtype, array.dtype)
            np.testing.assert_array_equal(read[name], array)
        self.assertEqual(os.listdir(self.folder), ["w.safetensors"])

    def test_writes_equal_bytes_for_equal_content_in_any_order(self):
        turned = dict(reversed(list(self.tensors().items())))
        self.assertEqual(safetensors.to_bytes(self.tensors(), {"a": "1", "b": "2"}),
                         safetensors.to_bytes(turned, {"b": "2", "a": "1"}))

    def test_writes_arrays_that_are_not_contiguous(self):
        array = np.arange(12, dtype=np.float32).reshape(3, 4).T
        read, _ = safetensors.from_bytes(safetensors.to_bytes({"t": array}, {}), "f")
        np.testing.assert_array_equal(read["t"], array)

    def test_refuses_to_write_other_types(self):
        with self.assertRaisesRegex(safetensors.SafetensorsError, "float64"):
            safetensors.to_bytes({"t": np.zeros(2)}, {})

    def test_refuses_every_truncation_and_a_tail(self):
        data = safetensors.to_bytes(self.tensors(), {"k": "v"})
        for size in range(len(data)):
            with self.assertRaises(safetensors.SafetensorsError):
                safetensors.from_bytes(data[:size], "f")
        with self.assertRaises(safetensors.SafetensorsError):
            safetensors.from_bytes(data + b"x", "f")

    def refused(self, header, text, body=b"12345678"):
        header = header if isinstance(header, bytes) else json.dumps(header).encode()
        with self.assertRaisesRegex(safetensors.SafetensorsError, text):
            safetensors.from_bytes(struct.pack("<Q", len(header)) + header + body, "f")

    def test_refuses_broken_headers(self):
        good = {"dtype": "F32", "shape": [2], "data_offsets": [0, 8]}
        self.refused(b"[]", "found list")
        self.refused(b'{"a":1,"a":1}', "twice")
        self.refused(b"{" * 5000, "no JSON")
        self.refused({"a": {**good, "dtype": "I64"}}, "I64")
        self.refused({"a": {**good, "dtype": []}}, "dtype")
        self.refused({"a": {**good, "shape": [3]}}, "expected 12")
        self.refused({"a": {**good, "shape": [True, 2]}}, "whole numbers")
        self.refused({"a": {**good, "data_offsets": [0, 9]}}, "within 8")
        self.refused({"a": {**good, "data_offsets": [8, 0]}}, "within 8")
        self.refused({"a": good, "b": good}, "begins at byte 0, expected 8")
        self.refused({"__metadata__": {"k": 1}}, "texts")


class Ran:
    """Would be noticed if a checkpoint could run anything."""

    def __reduce__(self):
        return (os.mkdir, (str(self.folder / "ran"),))


class Checkpoint(Folder):
    def zipped(self, content, storages=None):
        file = self.folder / "c.pth"
        with zipfile.ZipFile(file, "w") as archive:
            archive.writestr("c/data.pkl", content)
            for name, data in (storages or {}).items():
                archive.writestr(f"c/data/{name}", data)
        return file

    def refused(self, file, text):
        with self.assertRaisesRegex(torch_checkpoint.CheckpointError, text):
            torch_checkpoint.load_state_dict(file)

    def test_runs_nothing_that_a_pickle_names(self):
        bomb = Ran()
        bomb.folder = self.folder
        self.refused(self.zipped(pickle.dumps({"model_state": {"w": bomb}})), "'w' that is no tensor")
        (self.folder / "c.pth").write_bytes(pickle.dumps(bomb))
        self.refused(self.folder / "c.pth", "expected a PyTorch checkpoint")
        for module, name in (("builtins", "eval"), ("os", "system"), ("torch.serialization", "load")):
            self.refused(self.zipped(f"c{module}\n{name}\n(S'1'\ntR.".encode()), "no state dict")
        self.assertEqual(sorted(os.listdir(self.folder)), ["c.pth"])

    def test_refuses_what_is_no_checkpoint(self):
        file = self.folder / "c.pth"
        for content in (b"", b"\x80\x02", b"text", os.urandom(100)):
            file.write_bytes(content)
            self.refused(file, "c.pth")
        self.refused(self.zipped(pickle.dumps({})), "no state dict")
        self.refused(self.zipped(pickle.dumps(3)), "no state dict")

    def tensor(self, offset, shape, strides, count=6):
        """A zip with one tensor of a storage of six floats, as PyTorch pickles it."""
        # By hand: protocol 0 opcodes, since the names cannot be imported without PyTorch.
        def numbers(values):
            return "(" + "".join(f"I{value}\n" for value in values) + "t"

        text = ("(S'w'\nctorch._utils\n_rebuild_tensor_v2\n((S'storage'\nctorch\nFloatStorage\nS'0'\nS'cpu'\n"
                f"I{count}\ntQI{offset}\n{numbers(shape)}{numbers(strides)}I00\nNtRd.")
        return self.zipped(text.encode(), {"0": np.arange(6, dtype="<f4").tobytes()})

    def test_reads_a_view_of_a_storage(self):
        read = torch_checkpoint.load_state_dict(self.tensor(1, [2, 2], [1, 3]))
        np.testing.assert_array_equal(read["w"], [[1, 4], [2, 5]])

    def test_refuses_views_beyond_their_storage(self):
        self.refused(self.tensor(3, [2, 2], [1, 3]), "ends at number 7")
        self.refused(self.tensor(-1, [2], [1]), "shape")
        self.refused(self.tensor(4, [2], [-2]), "strides")
        self.refused(self.tensor(0, [2], [1, 1]), "strides")
        self.refused(self.tensor(0, [1000000, 1000000], [0, 0]), "1000000000000 numbers")
        self.refused(self.tensor(0, [2], [1], count=7), "24 bytes, expected 7")
        self.refused(self.tensor(0, [2], [1], count=-1), "storage of -1")

    @needs_torch
    def test_reads_what_torch_writes_in_both_containers(self):
        state = collections.OrderedDict(
            w=torch.arange(24, dtype=torch.float32).reshape(2, 3, 4).transpose(0, 2),
            half=torch.tensor([0.5], dtype=torch.float16), count=torch.tensor(7),
            parameter=torch.nn.Parameter(torch.ones(3, dtype=torch.float64)), none=torch.zeros(0, 2))
        state["shared"] = state["w"][1]
        optimizer = torch.optim.Adam([torch.nn.Parameter(torch.ones(3))]).state_dict()
        for zipped in (True, False):
            file = self.folder / f"{zipped}.pth"
            torch.save({"epoch": 3, "model_state": state, "optimizer_state": optimizer, "when": pathlib.PurePosixPath("x")},
                       file, _use_new_zipfile_serialization=zipped)
            read = torch_checkpoint.load_state_dict(file)
            self.assertEqual(list(read), list(state))
            for name, tensor in state.items():
                np.testing.assert_array_equal(read[name], tensor.detach().numpy())
            data = file.read_bytes()
            for size in range(0, len(data) - 1, 29):
                (self.folder / "cut.pth").write_bytes(data[:size])
                self.refused(self.folder / "cut.pth", "cut.pth")


class Yaml(Folder):
    def test_merges_the_yaml_it_is_based_on_as_openpcdet_does(self):
        configs = self.folder / "tools/cfgs"
        (configs / "base").mkdir(parents=True)
        (configs / "base/data.yaml").write_text("A: {x: 1, y: [1, 2]}\nB: 2\nC: {z: 1}\n")
        own = configs / "own.yaml"
        own.write_text("DATA: {_BASE_CONFIG_: cfgs/base/data.yaml, A: {y: [3]}, C: 5, D: {E: {F: 1}}}\n")
        self.assertEqual(openpcdet.read_yaml(own),
                         {"DATA": {"A": {"x": 1, "y": [3]}, "B": 2, "C": 5, "D": {"E": {"F": 1}}}})
        own.write_text("_BASE_CONFIG_: cfgs/none.yaml\n")
        with self.assertRaisesRegex(openpcdet.ConversionError, "found no cfgs/none.yaml"):
            openpcdet.read_yaml(own)

    def test_builds_no_python_objects(self):
        own = self.folder / "own.yaml"
        own.write_text(f"a: !!python/object/apply:os.mkdir ['{self.folder}/ran']\n")
        with self.assertRaises(yaml.YAMLError):
            openpcdet.read_yaml(own)
        self.assertEqual(os.listdir(self.folder), ["own.yaml"])


@needs_torch
class Conversion(Folder):
    def setUp(self):
        super().setUp()
        self.yaml = copy.deepcopy(openpcdet_network.YAML)
        self.state = openpcdet_network.state_dict()

    def config(self, **how):
        return openpcdet.config_of(self.yaml, "tiny", **how)

    def test_gives_the_same_numbers_from_every_layout(self):
        kept, metadata = safetensors.load(TINY / "weights.safetensors")
        self.assertEqual(json.loads(metadata["config"])["heads"], self.config()["heads"])
        for layout in openpcdet.LAYOUTS:
            state = openpcdet_network.in_layout(self.state, layout)
            self.assertEqual(openpcdet.layout_of(state, openpcdet.layers_of(self.config())), layout)
            tensors = openpcdet.converted(state, self.config())
            self.assertEqual(set(tensors), set(kept))
            for name, tensor in tensors.items():
                np.testing.assert_allclose(tensor, kept[name], rtol=1e-6, atol=1e-7, err_msg=name)

    def refused(self, text, **how):
        with self.assertRaisesRegex(openpcdet.ConversionError, text):
            openpcdet.converted(self.state, self.config(**how))

    def test_refuses_a_checkpoint_that_does_not_fit_its_yaml(self):
        whole = dict(self.state)
        self.state["dense_head.more"] = np.zeros(3, np.float32)
        self.refused("1 tensors that the YAML does not ask for, the first dense_head.more")
        self.state = {name: array for name, array in whole.items() if name != "backbone_3d.conv4.1.bn2.running_var"}
        self.refused("found no backbone_3d.conv4.1.bn2.running_var")
        self.state = {**whole, "backbone_3d.conv_out.1.weight": np.zeros(3, np.float32)}
        self.refused("conv_out.1.weight")
        self.state = {**whole, "backbone_3d.conv_out.0.weight": np.zeros((6, 3, 3, 6), np.float32)}
        self.refused("fit no layout")
        self.state = {**whole, "backbone_3d.conv_out.1.bias": np.full(6, np.nan, np.float32)}
        self.refused("neck.out.bias: found a number that is not finite")

    def test_refuses_a_network_of_another_kind(self):
        for path, value, text in (
                ("MODEL.VFE.NAME", "DynamicVoxelVFE", "a mean of points"),
                ("MODEL.BACKBONE_3D.NAME", "VoxelResBackBone8xVoxelNeXt2D", "BACKBONE_3D.NAME"),
                ("MODEL.BACKBONE_3D.CHANNELS", [2, 3, 4, 5, 6], "the last two are equal"),
                ("MODEL.DENSE_HEAD.NUM_HM_CONV", 3, "NUM_HM_CONV"),
                ("MODEL.DENSE_HEAD.SHARED_CONV_CHANNEL", 5, "SHARED_CONV_CHANNEL"),
                ("MODEL.DENSE_HEAD.RECTIFIER", [0.5], "RECTIFIER"),
                ("DATA_CONFIG.POINT_FEATURE_ENCODING.used_feature_list", ["x", "colour"], "'colour'"),
                ("DATA_CONFIG.DATA_PROCESSOR", [], "no VOXEL_SIZE")):
            self.yaml = copy.deepcopy(openpcdet_network.YAML)
            *folders, key = path.split(".")
            section = self.yaml
            for folder in folders:
                section = section[folder]
            section[key] = value
            self.refused(text)
            del section[key]
            if key not in ("CHANNELS", "SHARED_CONV_CHANNEL"):  # those have defaults there
                self.refused(key)

    def test_asks_for_what_a_yaml_does_not_say(self):
        self.yaml["DATA_CONFIG"]["DATASET"] = "CustomDataset"
        self.refused("--sensor-height")
        self.assertEqual(self.config(sensor_height_m=2.5)["sensor_height_m"], 2.5)
        self.yaml["CLASS_NAMES"] = ["car", "truck", "zeppelin"]
        self.yaml["MODEL"]["DENSE_HEAD"]["CLASS_NAMES_EACH_HEAD"] = [["truck", "zeppelin"], ["car"]]
        self.refused("--class zeppelin=OURS", sensor_height_m=2.5)
        config = self.config(sensor_height_m=2.5, classes={"zeppelin": "bus"})
        self.assertEqual(config["heads"][0], {"classes": ["truck", "bus"]})

    def test_converts_as_a_program(self):
        (self.folder / "tiny.yaml").write_text(yaml.safe_dump(self.yaml))
        state = {name: torch.from_numpy(array) for name, array in self.state.items()}
        torch.save({"model_state": state, "version": "0.6"}, self.folder / "c.pth", _use_new_zipfile_serialization=False)
        command = [sys.executable, "-B", HERE / "convert_openpcdet.py", "c.pth", "tiny.yaml", "-o", "out.safetensors"]
        run = subprocess.run(command, cwd=self.folder, capture_output=True, text=True)
        self.assertEqual((run.returncode, run.stderr), (0, ""))
        read, metadata = safetensors.load(self.folder / "out.safetensors")
        kept, _ = safetensors.load(TINY / "weights.safetensors")
        self.assertEqual({name: tensor.shape for name, tensor in read.items()},
                         {name: tensor.shape for name, tensor in kept.items()})
        self.assertEqual(json.loads(metadata["config"])["name"], "tiny")
        smaller = ["--range", "-8", "-8", "-2", "8", "8", "2.5"]
        run = subprocess.run([*command, "--half", "--class", "car=van", *smaller], cwd=self.folder, capture_output=True,
                             text=True)
        self.assertEqual(run.returncode, 0, run.stderr)
        halves, metadata = safetensors.load(self.folder / "out.safetensors")
        self.assertEqual(json.loads(metadata["config"])["heads"][1], {"classes": ["van"]})
        self.assertEqual(json.loads(metadata["config"])["range_m"], [-8.0, -8.0, -2.0, 8.0, 8.0, 2.5])
        self.assertEqual({tensor.dtype for tensor in halves.values()}, {np.dtype(np.float16)})
        (self.folder / "c.pth").write_bytes(b"no")
        run = subprocess.run(command, cwd=self.folder, capture_output=True, text=True)
        self.assertEqual(run.returncode, 1)
        self.assertEqual(len(run.stderr.splitlines()), 1, run.stderr)
        self.assertIn("c.pth", run.stderr)


if __name__ == "__main__":
    unittest.main()
