#!/usr/bin/env python3
"""The training code against dense PyTorch and against itself. Needs the `train` packages."""

import pathlib
import sys
import tempfile
import unittest

try:
    import torch
except ImportError as error:
    print(f"skipped: {error} (Debian: python3-torch)")
    sys.exit(77)

import copy
import itertools
import json

import losses
import network
import numpy as np
import safetensors
import scans
import sparse_products
import starting

TRUTH = pathlib.Path(__file__).resolve().parents[2] / "tests/data/voxelnext"

CONFIG = {
    "range_m": [-6.4, -6.4, 0.0, 6.4, 6.4, 1.6], "voxel_m": [0.1, 0.1, 0.2],
    "features": ["dx", "dy", "dz", "height", "ux", "uy"],
    "stages": [{"channels": c, "blocks": 1, "kernel": 3} for c in (16, 16, 16, 32, 32, 32)],
    "pruning": [0.0] * 5, "neck_channels": 32, "head_kernel": 1, "heads": [{"classes": ["car", "van"]}],
    "branches": ["hm", "center", "center_z", "dim", "rot", "iou"],
}


def some_sites(shape, number, seed=0):
    generator = torch.Generator().manual_seed(seed)
    columns = [torch.randint(0, n, (number,), generator=generator) for n in [2, *shape]]
    return torch.unique(torch.stack(columns, -1), dim=0)


def dense(features, sites, shape):
    volume = torch.zeros(2, features.shape[1], *shape)
    volume[sites[:, 0], :, sites[:, 1], sites[:, 2], sites[:, 3]] = features
    return volume


def as_dense_weight(weight):
    return weight.view(3, 3, 3, *weight.shape[1:]).permute(4, 3, 0, 1, 2)


class SparseConvolutions(unittest.TestCase):
    shape = [7, 20, 22]

    def check(self, stride):
        sites = some_sites(self.shape, 500)
        features, weight = torch.randn(len(sites), 16), torch.randn(27, 16, 32)
        if stride == 1:
            rulebook, places = network.Rulebook.submanifold(sites, self.shape, 3), sites
        else:
            rulebook, places, _ = network.Rulebook.strided(sites, self.shape, 3, stride)
        found = network.SparseConvolve.apply(features, weight, rulebook)
        volume = torch.nn.functional.conv3d(dense(features, sites, self.shape),
                                            as_dense_weight(weight), stride=stride, padding=1)
        expected = volume[places[:, 0], :, places[:, 1], places[:, 2], places[:, 3]]
        self.assertLess(float((found - expected).abs().max()), 1e-3)
        if stride > 1:  # and there is nothing where no site is
            volume[places[:, 0], :, places[:, 1], places[:, 2], places[:, 3]] = 0
            self.assertEqual(float(volume.abs().max()), 0.0)

    def test_submanifold_is_dense_at_the_sites(self):
        self.check(1)

    def test_strided_is_dense_and_misses_no_site(self):
        self.check(2)

    def test_pruned_sites_are_those_of_a_brute_force(self):
        for seed in range(4):
            sites = some_sites(self.shape, 300, seed)
            features = torch.randn(len(sites), 8, generator=torch.Generator().manual_seed(seed)).round()  # many ties
            dilates = network.dilating(features, sites, 0.5)
            reached, out_shape = set(), [(n - 1) // 2 + 1 for n in self.shape]
            for scan in (0, 1):
                rows = [i for i in range(len(sites)) if sites[i, 0] == scan]
                rows.sort(key=lambda i: (float(features[i].abs().sum()), -i))
                still = set(rows[:len(rows) // 2])
                self.assertEqual([not flag for flag in dilates[sorted(rows)]], [i in still for i in sorted(rows)])
                for i in rows:
                    for at in itertools.product(*[(1,) if i in still else (0, 1, 2)] * 3):
                        moved = [int(n) + 1 - k for n, k in zip(sites[i, 1:], at)]
                        place = [n // 2 for n in moved]
                        if not any(n % 2 for n in moved) and all(0 <= n < m for n, m in zip(place, out_shape)):
                            reached.add((scan, *place))
            rulebook, places, _ = network.Rulebook.strided(sites, self.shape, 3, 2, dilates)
            self.assertEqual([tuple(place) for place in places.tolist()], sorted(reached))
            # What there is sees all that lies under its kernel, as without pruning.
            weight = torch.randn(27, 8, 16)
            volume = torch.nn.functional.conv3d(dense(features, sites, self.shape), as_dense_weight(weight),
                                                stride=2, padding=1)
            found = network.SparseConvolve.apply(features, weight, rulebook)
            expected = volume[places[:, 0], :, places[:, 1], places[:, 2], places[:, 3]]
            self.assertLess(float((found - expected).abs().max()), 1e-3)

    def test_native_and_plain_give_the_same_gradients(self):
        if sparse_products.library is None:
            self.skipTest("no compiler")
        sites = some_sites(self.shape, 500)
        rulebook = network.Rulebook.strided(sites, self.shape, 3, 2)[0]
        start = torch.randn(len(sites), 48), torch.randn(27, 48, 80)
        results = []
        for library in (sparse_products.library, None):
            kept, sparse_products.library = sparse_products.library, library
            try:
                features, weight = (t.clone().requires_grad_() for t in start)
                out = network.SparseConvolve.apply(features, weight, rulebook)
                (out * torch.sin(torch.arange(out.numel()).view_as(out).float())).sum().backward()
                results.append((out.detach(), features.grad, weight.grad))
            finally:
                sparse_products.library = kept
        for a, b in zip(*results):
            self.assertLess(float((a - b).abs().max()), 1e-3)

    def test_folding_the_normalization_changes_nothing(self):
        layer = network.Convolution(16, 32, 27)
        layer.norm.running_mean.normal_()
        layer.norm.running_var.uniform_(0.5, 2.0)
        layer.eval()
        sites = some_sites(self.shape, 300)
        rulebook = network.Rulebook.submanifold(sites, self.shape, 3)
        features = torch.randn(len(sites), 16)
        weight, bias = layer.folded()
        folded = network.SparseConvolve.apply(features, weight, rulebook) + bias
        self.assertLess(float((layer(features, rulebook) - folded).abs().max()), 1e-3)


class Network(unittest.TestCase):
    def test_every_head_says_what_the_dense_reference_says(self):
        """The same files that the C++ program is tested with."""
        tensors, metadata = safetensors.load(TRUTH / "weights.safetensors")
        truth, _ = safetensors.load(TRUTH / "layers.safetensors")
        net = network.VoxelNext(json.loads(metadata["config"]))
        net.set_folded({name: torch.tensor(value) for name, value in tensors.items()})
        net.eval()
        sites = torch.tensor(truth["voxels.sites"]).long()
        sites = torch.cat([torch.zeros(len(sites), 1, dtype=torch.int64), sites], 1)
        with torch.no_grad():
            results, places = net(torch.tensor(truth["voxels.rows"]), sites)
        self.assertEqual(places[:, 1:].tolist(), truth["neck.out.sites"].astype(int).tolist())
        for h, result in enumerate(results):
            for name, found in result.items():
                expected = torch.tensor(truth[f"head{h}.{name}.1.rows"])
                self.assertLess(float((found - expected).abs().max()), 1e-4, (h, name))


    def batch(self, net):
        sites = some_sites(net.shape, 300)
        box = torch.tensor([[1.0, 2.0, 0.8, 4.2, 1.8, 1.5, 0.4]])
        return torch.randn(len(sites), 6), sites, [(box, ["car"], torch.tensor([50]))] * 2

    def folded_and_unfolded(self):
        torch.manual_seed(1)
        first, second = network.VoxelNext(CONFIG), network.VoxelNext(CONFIG)
        for module in first.modules():
            if isinstance(module, torch.nn.BatchNorm1d):
                module.running_mean.normal_()
                module.running_var.uniform_(0.5, 2.0)
        first.eval()
        second.set_folded(first.folded())
        batch = self.batch(second)
        starting.unfold_norms(second, [batch])
        return first, second, batch

    def test_normalizations_that_learn_again_change_nothing(self):
        first, second, batch = self.folded_and_unfolded()
        # On the batch that was measured they say the same while they learn, too.
        for net in (second.eval(), second.train()):
            expected, found = first(*batch[:2])[0], net(*batch[:2])[0]
            for name, value in expected[0].items():
                self.assertLess(float((found[0][name] - value).abs().max()), 1e-2, name)

    def test_channels_that_say_nothing_are_the_first_to_go(self):
        _, net, batch = self.folded_and_unfolded()
        config = copy.deepcopy(CONFIG)
        config["stages"][2]["channels"] = 32
        wide = network.VoxelNext(config)
        gone = [5, 6, 20]
        for layer in (wide.stage3.down, wide.stage3.block0.conv1, wide.stage3.block0.conv2):
            layer.norm.weight.data[gone] = 0.0
        expected = wide.eval()(*batch[:2])[0][0]
        found = starting.narrowed(wide, 2, 29, [batch])
        self.assertEqual(found.config["stages"][2]["channels"], 29)
        for name, value in found.eval()(*batch[:2])[0][0].items():
            self.assertLess(float((value - expected[name]).abs().max()), 1e-3, name)


def car_scan(rng):
    box = np.array([[8.0, 3.0, 0.8, 4.2, 1.8, 1.5, 0.4]], np.float32)
    local = (rng.random((400, 3)) - 0.5) * (box[0, 3:6] - 0.1)
    scans.rotate(local, box[0, 6])
    points = np.concatenate([local + box[0, :3], rng.uniform(-30, 30, (600, 3))]).astype(np.float32)
    points[400:, 2] = 0.01
    owners = np.r_[np.ones(400), np.zeros(600)].astype(np.uint16)
    rings = rng.integers(0, 64, 1000).astype(np.uint8)
    return scans.Scan(points, rings, owners, 1.7, box, np.zeros(1, np.uint8), np.zeros(1, np.uint8))


class Scans(unittest.TestCase):
    def test_an_objects_points_stay_in_its_box(self):
        for seed in range(40):
            rng = np.random.default_rng(seed)
            scan = scans.augment(car_scan(rng), rng)
            mine = scan.points[scan.owners == 1]
            self.assertTrue(scans.inside(mine, scan.boxes[0], 0.15).all(), seed)

    def test_pasted_objects_bring_their_points(self):
        pasted = 0
        for seed in range(20):
            rng = np.random.default_rng(seed)
            scan, other = car_scan(rng), car_scan(rng)
            scans.paste(scan, other, rng, {"car": 1.0})
            pasted += len(scan.boxes) - 1
            for i, box in enumerate(scan.boxes):
                mine = scan.points[scan.owners == i + 1]
                self.assertTrue(scans.inside(mine, box, 0.05).all())
        self.assertGreater(pasted, 3)

    def test_voxels_are_means_in_order(self):
        points = np.array([[0.01, 0.0, 0.3], [0.03, 0.0, 0.3], [-6.4, -6.4, 0.0], [6.4, 0, 0.3]],
                          np.float32)
        features, sites = scans.voxels(points, CONFIG)
        self.assertEqual(sites.tolist(), [[0, 0, 0], [1, 64, 64]])
        self.assertAlmostEqual(features[1][0], (0.02 - 0.05) / 0.1, places=4)
        self.assertAlmostEqual(features[1][3], 0.3, places=5)


class Losses(unittest.TestCase):
    def test_iou_of_rectangles(self):
        a = torch.tensor([[0, 0, 0, 4, 2, 1.5, 0.3]])
        for shift, expected in ((0.0, 1.0), (2.0, 1 / 3), (4.0, 0.0)):
            b = a.clone()
            b[0, 0] += shift * float(torch.tensor(0.3).cos())
            b[0, 1] += shift * float(torch.tensor(0.3).sin())
            self.assertAlmostEqual(float(losses.ground_plane_iou(a, b, 64)), expected, delta=0.02)

    def test_overlap_of_parallel_rectangles_is_their_iou(self):
        a = torch.tensor([[0.0, 0, 0, 4, 2, 1.5, 0.3], [0.5, 0.2, 0, 3, 1.5, 1.5, 0.3], [5, 5, 0, 1, 1, 1, 0.3]])
        b = torch.tensor([[0.4, 0.3, 0, 4.4, 1.8, 1.5, 0.3]]).expand(3, 7)
        difference = losses.overlap_if_parallel(a, b) - losses.ground_plane_iou(a, b, 64)
        self.assertLess(float(difference.abs().max()), 0.02)

    def test_what_the_targets_say_is_decoded_to_the_boxes(self):
        sites = torch.tensor([[5, 6], [6, 6], [7, 8]])
        boxes = torch.tensor([[0.3, -1.2, 0.8, 4.2, 1.8, 1.5, 1.2]]).expand(3, 7)
        found = losses.decoded(losses.box_targets(sites, boxes, CONFIG), sites, CONFIG)
        self.assertLess(float((found - boxes).abs().max()), 1e-4)


class Files(unittest.TestCase):
    def test_a_truncated_file_is_refused(self):
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "train-0.stsc"
            header = b"STSC" + np.array([1, 4, 0], "<u4").tobytes() + np.float32(1.7).tobytes()
            path.write_bytes(header + bytes(4 * 9))
            self.assertEqual(len(scans.ScanFile(path)[0].points), 4)
            path.write_bytes(header + bytes(4 * 9 - 1))
            with self.assertRaises(ValueError):
                scans.ScanFile(path)


if __name__ == "__main__":
    unittest.main()
