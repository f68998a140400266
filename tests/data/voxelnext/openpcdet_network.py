"""A small VoxelNeXt as OpenPCDet has it, with random weights, run densely in plain PyTorch.

Dense grids with a mask of active sites; no sparse convolution, no folded normalization, no code shared with the
converter or the program: the truth for both. Layers as in the authors' spconv_backbone_voxelnext.py and
voxelnext_head.py (Chen et al., "VoxelNeXt", CVPR 2023).
"""

import numpy as np
import torch
import torch.nn.functional as F

# As an OpenPCDet YAML has it. Every size differs from its neighbours where that is allowed.
YAML = {
    "CLASS_NAMES": ["car", "truck", "barrier"],
    "DATA_CONFIG": {
        "DATASET": "NuScenesDataset",
        "POINT_CLOUD_RANGE": [-12.0, -14.0, -2.0, 12.0, 14.0, 2.5],
        "POINT_FEATURE_ENCODING": {"used_feature_list": ["x", "y", "z", "intensity", "timestamp"]},
        "DATA_PROCESSOR": [
            {"NAME": "shuffle_points"},
            {"NAME": "transform_points_to_voxels", "VOXEL_SIZE": [0.25, 0.25, 0.25]},
        ],
    },
    "MODEL": {
        "VFE": {"NAME": "MeanVFE"},
        "BACKBONE_3D": {
            "NAME": "VoxelResBackBone8xVoxelNeXt",
            "CHANNELS": [2, 3, 4, 5, 5],
            "SPCONV_KERNEL_SIZES": [3, 5, 3, 3],
            "OUT_CHANNEL": 6,
        },
        "DENSE_HEAD": {
            "NAME": "VoxelNeXtHead",
            "CLASS_NAMES_EACH_HEAD": [["truck", "barrier"], ["car"]],
            "SHARED_CONV_CHANNEL": 6,
            "KERNEL_SIZE_HEAD": 3,
            "IOU_BRANCH": True,
            "RECTIFIER": [0.1, 0.2, 0.3],
            "NUM_HM_CONV": 2,
            "SEPARATE_HEAD_CFG": {
                "HEAD_DICT": {
                    "center": {"out_channels": 2, "num_conv": 2},
                    "center_z": {"out_channels": 1, "num_conv": 2},
                    "dim": {"out_channels": 3, "num_conv": 2},
                    "rot": {"out_channels": 2, "num_conv": 2},
                    "iou": {"out_channels": 1, "num_conv": 2},
                    "vel": {"out_channels": 2, "num_conv": 2},
                }
            },
            "TARGET_ASSIGNER_CONFIG": {"FEATURE_MAP_STRIDE": 8},
            "POST_PROCESSING": {"SCORE_THRESH": 0.15, "NMS_CONFIG": {"NMS_THRESH": [0.8, 0.3, 0.55]}},
        },
    },
}
CHANNELS = [2, 3, 4, 5, 5, 5]
KERNELS = [3, 3, 5, 3, 3, 3]
NECK = 6
BRANCHES = {"center": 2, "center_z": 1, "dim": 3, "rot": 2, "iou": 1, "vel": 2}
HEADS = [2, 1]
GRID = (19, 112, 96)  # z, y, x; OpenPCDet adds one cell in z


def state_dict(seed=4):
    """A random network: {OpenPCDet's name: float32 array}, weights as spconv 2 has them [out, kernel..., in]."""
    random = np.random.default_rng(seed)
    state = {"global_step": np.array([7], np.int64)}

    def convolution(name, c_in, c_out, kernel, dimensions, bias):
        # A few positions of a kernel meet a site; features stay about 1 from layer to layer.
        deviation = np.sqrt((1.5 if dimensions == 3 else 1.0) / (c_in * max(kernel**dimensions, 3)))
        state[name + ".weight"] = random.normal(0, deviation, (c_out, *[kernel] * dimensions, c_in))
        if bias:
            state[name + ".bias"] = random.normal(0, 0.2, c_out)

    def normalization(name, channels):
        state[name + ".weight"] = random.uniform(0.6, 1.4, channels)
        state[name + ".bias"] = random.normal(0, 0.2, channels)
        state[name + ".running_mean"] = random.normal(0, 0.2, channels)
        # A wrong epsilon, 0.001 more or less, changes such a figure by far more than 1e-4.
        state[name + ".running_var"] = random.uniform(0.2, 1.0, channels)
        state[name + ".num_batches_tracked"] = np.array(7, np.int64)

    before, backbone = 5, "backbone_3d."
    for i, (channels, kernel) in enumerate(zip(CHANNELS, KERNELS), 1):
        opening = f"{backbone}conv_input." if i == 1 else f"{backbone}conv{i}.0."
        convolution(opening + "0", before, channels, kernel, 3, bias=False)
        normalization(opening + "1", channels)
        for j in (0, 1):
            block = f"{backbone}conv{i}.{j if i == 1 else j + 1}."
            for k in (1, 2):
                convolution(f"{block}conv{k}", channels, channels, 3, 3, bias=True)
                normalization(f"{block}bn{k}", channels)
        before = channels
    for name, c_in, bias in (("conv_out", before, False), ("shared_conv", NECK, True)):
        convolution(f"{backbone}{name}.0", c_in, NECK, 3, 2, bias)
        normalization(f"{backbone}{name}.1", NECK)
    for h, classes in enumerate(HEADS):
        for branch, channels in {**BRANCHES, "hm": classes}.items():
            name = f"dense_head.heads_list.{h}.{branch}."
            convolution(name + "0.0", NECK, NECK, 3, 2, bias=True)
            normalization(name + "0.1", NECK)
            convolution(name + "1", NECK, channels, 1, 2, bias=True)
    return {name: array if array.dtype == np.int64 else array.astype(np.float32) for name, array in state.items()}


def in_layout(state, layout):
    """The same network as another spconv writes it: "spconv 1", "spconv 2, native" or "spconv 2"."""
    turn = {"spconv 1": lambda w: np.moveaxis(w, 0, -1), "spconv 2": lambda w: w,
            "spconv 2, native": lambda w: np.swapaxes(np.moveaxis(w, 0, -1), -1, -2)}[layout]
    return {name: np.ascontiguousarray(turn(array)) if array.ndim >= 4 else array for name, array in state.items()}


def scene(seed=5):
    """@return (sites int [N, 3] z y x, on a rough floor, a wall and at the grid's borders; features [N, 5])."""
    random = np.random.default_rng(seed)
    z, y, x = GRID
    floor = [(2 + int(random.integers(2)), j, i) for j in range(4, 20, 2) for i in range(6, 22, 2)]
    wall = [(k, 30, i) for k in range(1, 9, 2) for i in range(20, 30)]
    corners = [(k, j, i) for k in (0, z - 2) for j in (0, y - 1) for i in (0, x - 1)]
    far = [tuple(int(random.integers(n)) for n in (z - 1, y, x)) for _ in range(5)]
    sites = np.array(sorted({*floor, *wall, *corners, *far}))
    features = random.normal(0, 1, (len(sites), 5))
    features[:, 4] = 0.0  # "timestamp"
    return sites, features.astype(np.float32)


class Dense:
    """A sparse tensor as a dense one [1, C, (z,) y, x] with a mask [1, 1, (z,) y, x] of what is active."""

    def __init__(self, values, mask):
        self.values, self.mask = values * mask, mask

    def sites(self):
        return self.mask[0, 0].nonzero().numpy()

    def rows(self):
        return self.values[0][(slice(None), *self.mask[0, 0].nonzero().T)].T.numpy()


class Network:
    def __init__(self, state):
        self.state = {name: torch.from_numpy(array.astype(np.float64)) for name, array in state.items()}
        self.layers = {}

    def convolution(self, name, x, stride=1, submanifold=True):
        weight = self.state[name + ".weight"].movedim(-1, 1)  # [out, in, kernel...]
        pad = weight.shape[-1] // 2
        function = F.conv3d if weight.dim() == 5 else F.conv2d
        values = function(x.values, weight, self.state.get(name + ".bias"), stride, pad)
        if submanifold:
            return Dense(values, x.mask)
        ones = torch.ones(1, 1, *weight.shape[2:], dtype=torch.float64)
        return Dense(values, (function(x.mask, ones, None, stride, pad) > 0.5).double())

    def normalized(self, name, x, epsilon):
        part = {key: self.state[f"{name}.{key}"] for key in ("running_mean", "running_var", "weight", "bias")}
        values = F.batch_norm(x.values, part["running_mean"], part["running_var"], part["weight"], part["bias"],
                              training=False, eps=epsilon)
        return Dense(values, x.mask)

    def opened(self, name, x, epsilon=1e-3, **how):
        x = self.normalized(name + "1", self.convolution(name + "0", x, **how), epsilon)
        return Dense(x.values.relu(), x.mask)

    def block(self, name, x, ours):
        inner = self.normalized(name + "bn1", self.convolution(name + "conv1", x), 1e-3)
        inner = Dense(inner.values.relu(), x.mask)
        self.layers[ours + ".conv1"] = inner
        outer = self.normalized(name + "bn2", self.convolution(name + "conv2", inner), 1e-3)
        self.layers[ours + ".conv2"] = Dense((outer.values + x.values).relu(), x.mask)
        return self.layers[ours + ".conv2"]

    def backbone(self, x):
        stages = []
        for i in range(1, 7):
            if i == 1:
                x = self.layers["input"] = self.opened("backbone_3d.conv_input.", x)
            else:
                x = self.opened(f"backbone_3d.conv{i}.0.", x, stride=2, submanifold=False)
                self.layers[f"stage{i}.down"] = x
            for j in (0, 1):
                x = self.block(f"backbone_3d.conv{i}.{j if i == 1 else j + 1}.", x, f"stage{i}.block{j}")
            stages.append(x)
        return stages[3:]

    def merged(self, stages):
        """Sites of stages 5 and 6 at twice and four times their place, then all summed over z."""
        values = stages[0].values.sum(2)
        mask = stages[0].mask.amax(2)
        for scale, stage in ((2, stages[1]), (4, stages[2])):
            for batch, _, z, y, x in stage.mask.nonzero():
                values[batch, :, scale * y, scale * x] += stage.values[batch, :, z, y, x]
                mask[batch, :, scale * y, scale * x] = 1.0
        return Dense(values, mask)

    def run(self, sites, features):
        """@return {name of our layer: Dense}, each after its ReLU and residual sum."""
        values = torch.zeros(1, features.shape[1], *GRID, dtype=torch.float64)
        mask = torch.zeros(1, 1, *GRID, dtype=torch.float64)
        place = tuple(torch.from_numpy(sites).T)
        values[(0, slice(None), *place)] = torch.from_numpy(features.astype(np.float64)).T
        mask[(0, 0, *place)] = 1.0
        x = self.layers["merge"] = self.merged(self.backbone(Dense(values, mask)))
        x = self.layers["neck.out"] = self.opened("backbone_3d.conv_out.", x, submanifold=False)
        x = self.layers["neck.shared"] = self.opened("backbone_3d.shared_conv.", x, epsilon=1e-5)
        for h, _ in enumerate(HEADS):
            for branch in ("hm", *BRANCHES):
                name = f"dense_head.heads_list.{h}.{branch}."
                inner = self.opened(name + "0.", x, epsilon=1e-5)
                self.layers[f"head{h}.{branch}.1"] = self.convolution(name + "1", inner)
        return self.layers
