"""VoxelNeXt in plain PyTorch: sparse convolutions as a gather and one matrix product.

Chen, Liu, Zhang, Qi, Jia, "VoxelNeXt: Fully Sparse VoxelNet for 3D Object Detection and Tracking",
CVPR 2023. Names and shapes of the layers are those of the weights file that the C++ program reads
(mapping/src/detection/voxelnext). No layer needs a GPU or a package beyond torch.

A sparse tensor is a list of sites, int64 [N, 4] of (scan, z, y, x) without repetition, with
features [N, C]. A convolution has a table [N_out, K] that says for each output site and kernel
position which input row lies there; row N_in stands for nothing and is zero.
"""

import math

import sparse_products
import torch
from torch import nn


class Grid:
    """Finds sites by place. Dense, with a border, reused: filled for one rulebook, then emptied."""

    buffers = {}

    def __init__(self, sites, shape, border):
        self.shape, self.border = shape, border
        self.padded = [n + 2 * border for n in shape]
        scans = int(sites[:, 0].max()) + 1 if len(sites) else 1
        size = scans * math.prod(self.padded)
        key = sites.device
        buffer = Grid.buffers.get(key)
        if buffer is None or len(buffer) < size:
            buffer = torch.full((size,), -1, dtype=torch.int32, device=sites.device)
            Grid.buffers[key] = buffer
        self.buffer = buffer
        self.used = self.index(sites)
        buffer[self.used] = torch.arange(len(sites), dtype=torch.int32, device=sites.device)

    def index(self, sites):
        index = sites[:, 0]
        for axis, n in enumerate(self.padded):
            index = index * n + sites[:, axis + 1] + self.border
        return index

    def offsets(self, kernel):
        """Distance in the buffer to each kernel position, counted from the first one."""
        steps = torch.arange(kernel, device=self.buffer.device)
        total = torch.zeros(1, dtype=torch.int64, device=self.buffer.device)
        for n in self.padded:
            total = (total[:, None] * n + steps[None, :]).reshape(-1)
        return total

    def look_up(self, index, nothing):
        found = self.buffer[index].long()
        return torch.where(found < 0, torch.full_like(found, nothing), found)

    def clear(self):
        self.buffer[self.used] = -1


def submanifold_table(sites, shape, kernel):
    """[N, K]: which site lies at each kernel position around each site."""
    half = kernel // 2
    grid = Grid(sites, shape, half)
    first = sites.clone()
    first[:, 1:] -= half
    table = grid.look_up(grid.index(first)[:, None] + grid.offsets(kernel)[None, :], len(sites))
    grid.clear()
    return table


def dilating(features, sites, share):
    """Spatial voxel pruning, as pruning.cpp has it: [N], false for the share of each scan's sites with the
    smallest sums of |feature|; of equal sums for those of higher rows. Sites are in the order of scans."""
    flags = torch.ones(len(sites), dtype=torch.bool, device=sites.device)
    magnitude, first = features.detach().abs().sum(1), 0
    for count in torch.bincount(sites[:, 0]).tolist():
        order = torch.sort(magnitude[first:first + count].flip(0), stable=True)[1]
        flags[first + count - 1 - order[:int(share * count)]] = False
        first += count
    return flags


def strided_sites(sites, shape, kernel, stride, dilates=None):
    """Sites with an input in their window, their grid, and each input's [N, K] outputs (-1 = none).
    @param dilates  [N]; false where an input makes an output only under the middle of its kernel."""
    pad, axes = kernel // 2, len(shape)
    out_shape = [(n + 2 * pad - kernel) // stride + 1 for n in shape]
    steps = torch.arange(kernel, device=sites.device)
    key = sites[:, 0].view(-1, *[1] * axes)
    valid = torch.ones_like(key, dtype=torch.bool)
    for axis, n in enumerate(out_shape):
        # Input i is at kernel position d of output o where i = o * stride - pad + d.
        moved = sites[:, axis + 1:axis + 2] + pad - steps
        target = torch.div(moved, stride, rounding_mode="floor")
        fits = (target * stride == moved) & (target >= 0) & (target < n)
        dimensions = [len(sites)] + [kernel if a == axis else 1 for a in range(axes)]
        key = key * n + target.view(dimensions)
        valid = valid & fits.view(dimensions)
    key, valid = key.reshape(len(sites), -1), valid.reshape(len(sites), -1)
    if dilates is None:
        unique, rows = torch.unique(key[valid], return_inverse=True)
    else:
        makes = valid & dilates[:, None]
        middle = valid.shape[1] // 2
        makes[:, middle] = valid[:, middle]
        unique = torch.unique(key[makes])
        rows = torch.searchsorted(unique, key).clamp(max=len(unique) - 1)
        valid &= unique[rows] == key
        rows = rows[valid]
    outputs = torch.full(valid.shape, -1, dtype=torch.int64, device=sites.device)
    outputs[valid] = rows
    columns = []
    for n in reversed(out_shape):
        above = torch.div(unique, n, rounding_mode="floor")
        columns.append(unique - above * n)
        unique = above
    columns.append(unique)
    return torch.stack(columns[::-1], -1), out_shape, outputs


class Rulebook:
    """Tables of one convolution: `forward` [N_out, K] into the inputs, `backward` [N_in, K]."""

    def __init__(self, forward, backward, n_in, n_out, mirrored):
        self.forward, self.backward = forward, backward
        self.n_in, self.n_out, self.mirrored = n_in, n_out, mirrored
        native = sparse_products.native(forward)
        self.pairs = sparse_products.Pairs(forward, n_in) if native else None

    @staticmethod
    def submanifold(sites, shape, kernel):
        table = submanifold_table(sites, shape, kernel)
        # The gradient goes through the same table with the kernel turned round.
        return Rulebook(table, table, len(sites), len(sites), True)

    @staticmethod
    def strided(sites, shape, kernel, stride, dilates=None):
        out_sites, out_shape, outputs = strided_sites(sites, shape, kernel, stride, dilates)
        n_in, n_out = len(sites), len(out_sites)
        forward = torch.full((n_out, outputs.shape[1]), n_in, device=sites.device)
        source, position = torch.nonzero(outputs >= 0, as_tuple=True)
        forward[outputs[source, position], position] = source
        backward = torch.where(outputs < 0, torch.full_like(outputs, n_out), outputs)
        return Rulebook(forward, backward, n_in, n_out, False), out_sites, out_shape


def gather(features, table):
    """[N, C] and [M, K] to [M, K * C]; the row beyond the last is zero."""
    padded = torch.cat([features, features.new_zeros(1, features.shape[1])])
    return padded.index_select(0, table.reshape(-1)).view(table.shape[0], -1)


class SparseConvolve(torch.autograd.Function):
    @staticmethod
    def forward(context, features, weight, rulebook):
        context.save_for_backward(features, weight)
        context.rulebook = rulebook
        back = weight.shape[1:2] if context.needs_input_grad[0] else ()
        context.native = sparse_products.native(features, weight.shape[2], *back)
        if context.native:
            pairs = rulebook.pairs
            return sparse_products.multiply(features, weight, pairs.inputs, pairs.outputs,
                                            pairs.first, rulebook.n_out)
        return gather(features, rulebook.forward) @ weight.reshape(-1, weight.shape[2])

    @staticmethod
    def backward(context, gradient):
        features, weight = context.saved_tensors
        rulebook, of_features = context.rulebook, None
        if context.native:
            pairs = rulebook.pairs
            of_weight = sparse_products.weight_gradient(features, gradient, pairs, weight.shape)
            if context.needs_input_grad[0]:
                of_features = sparse_products.multiply(
                    gradient, weight.transpose(1, 2), pairs.outputs, pairs.inputs, pairs.first,
                    rulebook.n_in)
            return of_features, of_weight, None
        of_weight = gather(features, rulebook.forward).t() @ gradient
        if context.needs_input_grad[0]:
            turned = weight.flip(0) if rulebook.mirrored else weight
            turned = turned.transpose(1, 2).reshape(-1, weight.shape[1])
            of_features = gather(gradient, rulebook.backward) @ turned
        return of_features, of_weight.view_as(weight), None


class Convolution(nn.Module):
    """Sparse convolution and batch normalization; `weight` is [K, C_in, C_out]."""

    def __init__(self, channels_in, channels_out, volume, norm=True):
        super().__init__()
        self.weight = nn.Parameter(torch.empty(volume, channels_in, channels_out))
        # Only about a third of a kernel's positions hold a site.
        nn.init.normal_(self.weight, std=math.sqrt(2.0 / (channels_in * max(1.0, volume / 3.0))))
        self.norm = nn.BatchNorm1d(channels_out, eps=1e-3, momentum=0.02) if norm else None
        self.bias = None if norm else nn.Parameter(torch.zeros(channels_out))

    def forward(self, features, rulebook):
        if rulebook is None:
            result = features @ self.weight[0]
        else:
            result = SparseConvolve.apply(features, self.weight, rulebook)
        return self.norm(result) if self.norm is not None else result + self.bias

    def folded(self):
        """Weight and bias with the normalization in them."""
        if self.norm is None:
            return self.weight.detach(), self.bias.detach()
        scale = self.norm.weight / torch.sqrt(self.norm.running_var + self.norm.eps)
        bias = self.norm.bias - self.norm.running_mean * scale
        return (self.weight * scale).detach(), bias.detach()


class Block(nn.Module):
    def __init__(self, channels):
        super().__init__()
        self.conv1 = Convolution(channels, channels, 27)
        self.conv2 = Convolution(channels, channels, 27)

    def forward(self, features, rulebook):
        inner = torch.relu(self.conv1(features, rulebook))
        return torch.relu(features + self.conv2(inner, rulebook))


class Stage(nn.Module):
    """@param pruning  share of the sites below that do not dilate."""

    def __init__(self, channels_in, stage, opens, pruning):
        super().__init__()
        self.pruning = pruning
        channels, self.kernel = stage["channels"], stage["kernel"]
        self.down = Convolution(channels_in, channels, self.kernel**3) if opens else None
        for j in range(stage["blocks"]):
            setattr(self, f"block{j}", Block(channels))
        self.blocks = stage["blocks"]

    def forward(self, features, sites, shape):
        if self.down is not None:
            dilates = dilating(features, sites, self.pruning) if self.pruning > 0 else None
            rulebook, sites, shape = Rulebook.strided(sites, shape, self.kernel, 2, dilates)
            features = torch.relu(self.down(features, rulebook))
        if self.blocks:
            rulebook = Rulebook.submanifold(sites, shape, 3)
            for j in range(self.blocks):
                features = getattr(self, f"block{j}")(features, rulebook)
        return features, sites, shape


BRANCHES = {"center": 2, "center_z": 1, "dim": 3, "rot": 2, "iou": 1, "vel": 2}


class Branch(nn.Module):
    def __init__(self, channels, kernel, outputs, bias):
        super().__init__()
        self.first = Convolution(channels, channels, kernel * kernel)
        self.last = Convolution(channels, outputs, 1, norm=False)
        nn.init.normal_(self.last.weight, std=0.02)
        nn.init.constant_(self.last.bias, bias)

    def forward(self, features, rulebook):
        return self.last(torch.relu(self.first(features, rulebook)), None)


class VoxelNext(nn.Module):
    """@param config  as in the weights file."""

    def __init__(self, config):
        super().__init__()
        self.config = config
        low, high = config["range_m"][:3], config["range_m"][3:]
        size = [round((h - l) / v) for l, h, v in zip(low, high, config["voxel_m"])]
        self.shape = [size[2] + 1, size[1], size[0]]
        stages = config["stages"]
        channels = stages[0]["channels"]
        self.input = Convolution(len(config["features"]), channels, 27)
        for i, stage in enumerate(stages):
            pruning = config["pruning"][i - 1] if i > 0 else 0.0
            setattr(self, f"stage{i + 1}", Stage(channels, stage, i > 0, pruning))
            channels = stage["channels"]
        neck = config["neck_channels"]
        self.neck_out = Convolution(channels, neck, 9)
        self.neck_shared = Convolution(neck, neck, 9)
        kernel = config["head_kernel"]
        self.heads = nn.ModuleList()
        for head in config["heads"]:
            branches = nn.ModuleDict()
            for name in config["branches"]:
                outputs = len(head["classes"]) if name == "hm" else BRANCHES[name]
                branches[name] = Branch(neck, kernel, outputs, -2.19 if name == "hm" else 0.0)
            self.heads.append(branches)

    def forward(self, features, sites):
        """@param features  [N, F]. @param sites  [N, 4] (scan, z, y, x).
        @return features by branch for each head, and their sites [M, 3] (scan, y, x).
        """
        shape = self.shape
        rulebook = Rulebook.submanifold(sites, shape, 3)
        features = torch.relu(self.input(features, rulebook))
        merged, places = [], []
        for i in range(6):
            features, sites, shape = getattr(self, f"stage{i + 1}")(features, sites, shape)
            if i == 3:
                flat = shape[1:]
            if i >= 3:
                merged.append(features)
                places.append(torch.cat([sites[:, :1], sites[:, 2:] * 2 ** (i - 3)], 1))
        features, sites = self.flatten(torch.cat(merged), torch.cat(places), flat)
        rulebook, sites, _ = Rulebook.strided(sites, flat, 3, 1)
        features = torch.relu(self.neck_out(features, rulebook))
        rulebook = Rulebook.submanifold(sites, flat, 3)
        features = torch.relu(self.neck_shared(features, rulebook))
        if self.config["head_kernel"] == 1:
            rulebook = None
        results = [{name: branch(features, rulebook) for name, branch in head.items()}
                   for head in self.heads]
        return results, sites

    @staticmethod
    def flatten(features, sites, shape):
        """Sums what lies in one cell of the ground plane (paper, section 3.2)."""
        inside = (sites[:, 1] < shape[0]) & (sites[:, 2] < shape[1])
        features, sites = features[inside], sites[inside]
        key = (sites[:, 0] * shape[0] + sites[:, 1]) * shape[1] + sites[:, 2]
        unique, rows = torch.unique(key, return_inverse=True)
        summed = features.new_zeros(len(unique), features.shape[1]).index_add(0, rows, features)
        x = unique % shape[1]
        rest = torch.div(unique, shape[1], rounding_mode="floor")
        y, scan = rest % shape[0], torch.div(rest, shape[0], rounding_mode="floor")
        return summed, torch.stack([scan, y, x], -1)

    def folded(self):
        """Layers by their names in the weights file: weight [K, C_in, C_out] and bias."""
        layers = {}
        for name, module in self.layers():
            layers[name + ".weight"], layers[name + ".bias"] = module.folded()
        return layers

    def set_folded(self, layers):
        """Takes layers of a weights file over. Their normalizations are folded in: they only shift, until
        starting.unfold_norms lets them learn."""
        with torch.no_grad():
            for name, module in self.layers():
                module.weight.copy_(layers[name + ".weight"])
                bias = module.bias
                if module.norm is not None:
                    module.norm.running_mean.zero_()
                    module.norm.running_var.fill_(1.0 - module.norm.eps)
                    module.norm.weight.fill_(1.0)
                    bias = module.norm.bias
                bias.copy_(layers[name + ".bias"])

    def layers(self):
        """Convolutions with their names in the weights file."""
        for name, module in self.named_modules():
            if isinstance(module, Convolution):
                name = name.replace("neck_", "neck.").replace("heads.", "head")
                yield name.replace(".first", ".0").replace(".last", ".1"), module
