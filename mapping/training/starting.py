"""What a run begins from when it begins from a weights file: the file has its normalizations folded in, and may have
wider stages than the network that is to be trained."""

import copy
import json

import losses
import network
import safetensors
import torch


def network_of(path, config, batches):
    """The file's network with normalizations that learn, as narrow as `config` says.
    @param batches  (features, sites, scans), some ten of them, to measure on."""
    tensors, metadata = safetensors.load(path)
    theirs = json.loads(metadata["config"])
    for key in ("range_m", "voxel_m", "z", "features", "neck_channels", "head_kernel", "heads", "yaw", "branches"):
        if theirs.get(key) != config[key]:
            raise ValueError(f"{path}: {key}: found {theirs.get(key)}, expected {config[key]}")
    net = network.VoxelNext({**config, "stages": theirs["stages"]})
    net.set_folded({name: torch.tensor(value, dtype=torch.float32) for name, value in tensors.items()})
    unfold_norms(net, batches)
    for i in range(3):  # those that are summed later stay as wide as they are
        wanted = config["stages"][i]["channels"]
        if wanted < net.config["stages"][i]["channels"]:
            net = narrowed(net, i, wanted, batches)
    if net.config["stages"] != config["stages"]:
        raise ValueError(f"{path}: stages: found {theirs['stages']}, expected {config['stages']} or wider ones")
    return net


def unfold_norms(net, batches):
    """Lets normalizations learn again after set_folded: each takes the mean and variance of what it sees, and a scale
    and shift that undo them, so that the network says the same."""
    sums = {}

    def measure(norm, inputs):
        values = inputs[0].double()
        count, first, second = sums.get(norm, (0, 0.0, 0.0))
        sums[norm] = count + len(values), first + values.sum(0), second + (values**2).sum(0)

    norms = [module.norm for _, module in net.layers() if module.norm is not None]
    hooks = [norm.register_forward_pre_hook(measure) for norm in norms]
    net.eval()
    with torch.no_grad():
        for features, sites, _ in batches:
            net(features, sites)
        for norm, (count, first, second) in sums.items():
            mean = first / count
            norm.running_mean.copy_(mean)
            norm.running_var.copy_((second / count - mean**2).clamp(min=1e-4))
            norm.weight.copy_((norm.running_var + norm.eps).sqrt())
            norm.bias.add_(norm.running_mean)
    for hook in hooks:
        hook.remove()
    net.train()


def narrowed(net, index, channels, batches):
    """The network with fewer channels in a stage: those stay that the loss depends on most, by the squared change that
    the loss would see if they were 0, to first order (Molchanov et al., "Importance Estimation for Neural Network
    Pruning", CVPR 2019)."""
    opening = net.input if index == 0 else getattr(net, f"stage{index + 1}").down
    count = net.config["stages"][index]["blocks"]
    blocks = [getattr(getattr(net, f"stage{index + 1}"), f"block{j}") for j in range(count)]
    layers = [opening, *(layer for block in blocks for layer in (block.conv1, block.conv2))]
    importance = {layer: 0.0 for layer in layers}
    net.eval()
    for features, sites, scans in batches:
        net.zero_grad()
        losses.loss_of(*net(features, sites), scans, net.config)[0].backward()
        for layer in layers:
            norm = layer.norm
            importance[layer] += (norm.weight * norm.weight.grad + norm.bias * norm.bias.grad).detach() ** 2

    def most(values):
        return values.argsort(descending=True)[:channels].sort()[0]

    # What the opening and the second convolutions of the blocks say is added up.
    stream = most(sum(importance[layer] for layer in [opening, *(block.conv2 for block in blocks)]))
    config = copy.deepcopy(net.config)
    config["stages"][index]["channels"] = channels
    result = network.VoxelNext(config)
    state = net.state_dict()

    def cut(prefix, inputs, outputs):
        for name in [n for n in state if n.startswith(prefix + ".")]:
            if name.endswith("num_batches_tracked"):
                continue
            if name == prefix + ".weight" and inputs is not None:
                state[name] = state[name][:, inputs]
            if outputs is not None:
                state[name] = state[name][..., outputs]

    stage = f"stage{index + 1}"
    cut("input" if index == 0 else f"{stage}.down", None, stream)
    for j, block in enumerate(blocks):
        inner = most(importance[block.conv1])
        cut(f"{stage}.block{j}.conv1", stream, inner)
        cut(f"{stage}.block{j}.conv2", inner, stream)
    cut(f"stage{index + 2}.down", stream, None)
    result.load_state_dict(state)
    return result
