"""What an OpenPCDet VoxelNeXt is made of, in our words: its YAML as our config, its layers as ours.

Chen et al., "VoxelNeXt", CVPR 2023; names and orders as in the authors' OpenPCDet (spconv_backbone_voxelnext.py,
voxelnext_head.py). Ours are in mapping/src/detection/voxelnext/weights.hpp.
"""

import pathlib

import numpy as np
import yaml

# Epsilon of the normalizations: of the backbone as written there, elsewhere PyTorch's default.
BACKBONE_EPSILON = 1e-3
HEAD_EPSILON = 1e-5

BRANCHES = {"hm": None, "center": 2, "center_z": 1, "dim": 3, "rot": 2, "iou": 1, "vel": 2}
FEATURES = {"x": "x", "y": "y", "z": "z", "intensity": "intensity", "timestamp": "zero", "elongation": "zero"}
# Height of the network's z = 0 over the road [m]: KITTI and nuScenes in the frame of the LiDAR, Waymo in that of the
# vehicle, on the road.
SENSOR_HEIGHT_M = {"KittiDataset": 1.73, "NuScenesDataset": 1.84, "WaymoDataset": 0.0}

# OpenPCDet's names of classes, lower case, in KITTI, nuScenes, Waymo and Argoverse 2. "" is no object for a map.
CLASSES = {
    "car": "car", "vehicle": "car", "regular_vehicle": "car", "van": "van",
    "truck": "truck", "construction_vehicle": "truck", "large_vehicle": "truck", "box_truck": "truck",
    "truck_cab": "truck", "bus": "bus", "school_bus": "bus", "articulated_bus": "bus",
    "trailer": "trailer", "vehicular_trailer": "trailer", "message_board_trailer": "trailer", "tram": "tram",
    "motorcycle": "motorcycle", "motorcyclist": "motorcycle",
    "bicycle": "cyclist", "bicyclist": "cyclist", "cyclist": "cyclist", "wheeled_rider": "cyclist",
    "wheeled_device": "cyclist", "pedestrian": "pedestrian", "person_sitting": "pedestrian",
    "wheelchair": "pedestrian", "stroller": "pedestrian", "dog": "unknown", "misc": "unknown",
    "barrier": "", "traffic_cone": "", "bollard": "", "construction_cone": "", "construction_barrel": "", "sign": "",
    "stop_sign": "", "mobile_pedestrian_crossing_sign": "",
}


class ConversionError(ValueError):
    """Says what was found and what was expected."""


def expect(found, expected, what):
    if found != expected:
        raise ConversionError(f"{what}: found {found!r}, expected {expected!r}")


# --- configuration ---------------------------------------------------------------------------------------------------


def read_yaml(path):
    """A YAML with the ones it is based on below it, as OpenPCDet merges them."""
    path = pathlib.Path(path)
    with open(path, encoding="utf-8") as stream:
        own = yaml.safe_load(stream)
    if not isinstance(own, dict):
        raise ConversionError(f"{path}: found {type(own).__name__}, expected a mapping")
    return _merged({}, own, path)


def _merged(below, above, path):
    if "_BASE_CONFIG_" in above:
        below = {**below, **read_yaml(_base(path, str(above["_BASE_CONFIG_"])))}
    result = dict(below)
    for key, value in above.items():
        if isinstance(value, dict):
            base = result.get(key)
            result[key] = _merged(base if isinstance(base, dict) else {}, value, path)
        elif key != "_BASE_CONFIG_":
            result[key] = value
    return result


def _base(path, name):
    # OpenPCDet runs in its folder tools/, and names are relative to it.
    for folder in path.resolve().parents:
        if (folder / name).is_file():
            return folder / name
    raise ConversionError(f"{path}: found no {name} in the folders above it, expected the tools/ of OpenPCDet")


class _Section:
    """A mapping of the YAML that names the key it lacks."""

    def __init__(self, content, path=""):
        if not isinstance(content, dict):
            raise ConversionError(f"{path}: found {content!r:.60}, expected a mapping")
        self.content, self.path = content, path

    def at(self, key):
        if key not in self.content:
            raise ConversionError(f"the YAML: found no {self.path}{key}")
        return self.content[key]

    def section(self, key):
        return _Section(self.at(key), f"{self.path}{key}.")

    def get(self, key, default):
        return self.content.get(key, default)


def config_of(content, name, classes=None, sensor_height_m=None):
    """The config of our weights file.

    @param content what read_yaml gives.
    @param classes {OpenPCDet's class: name of ours or ""}, over CLASSES.
    @param sensor_height_m height of the network's z = 0 over the road [m]; None: by the data set.
    """
    root = _Section(content)
    data, model = root.section("DATA_CONFIG"), root.section("MODEL")
    head = model.section("DENSE_HEAD")
    if model.section("VFE").at("NAME") not in ("MeanVFE", "DynamicMeanVFE"):
        raise ConversionError(f"MODEL.VFE.NAME: found {model.section('VFE').at('NAME')!r}, expected a mean of points")
    expect(model.section("BACKBONE_3D").at("NAME"), "VoxelResBackBone8xVoxelNeXt", "MODEL.BACKBONE_3D.NAME")
    expect(head.at("NAME"), "VoxelNeXtHead", "MODEL.DENSE_HEAD.NAME")
    expect(head.section("TARGET_ASSIGNER_CONFIG").at("FEATURE_MAP_STRIDE"), 8, "FEATURE_MAP_STRIDE")
    heads = _heads(root, head)
    branches = _branches(head)
    config = {
        "name": name,
        "range_m": [float(value) for value in data.at("POINT_CLOUD_RANGE")],
        "voxel_m": _voxel(data),
        "z": "lidar",
        "sensor_height_m": _sensor_height(data, sensor_height_m),
        "features": _features(data),
        **_channels(model.section("BACKBONE_3D"), head),
        "pruning": [0.0] * 5,
        "heads": [{"classes": [_our_class(each, classes or {}) for each in names]} for names in heads],
        "yaw": "direction",
        "branches": branches,
        "iou_rectifier": _rectifier(root, head, heads),
        "calibration": [[1.0, 0.0] for names in heads for _ in names],
        **_suppression(head.section("POST_PROCESSING")),
    }
    return config


def _voxel(data):
    for step in data.at("DATA_PROCESSOR"):
        if step.get("NAME") in ("transform_points_to_voxels", "transform_points_to_voxels_placeholder"):
            return [float(value) for value in step["VOXEL_SIZE"]]
    raise ConversionError("DATA_CONFIG.DATA_PROCESSOR: found no VOXEL_SIZE, expected transform_points_to_voxels")


def _sensor_height(data, given):
    if given is not None:
        return float(given)
    dataset = data.get("DATASET", None)
    if dataset not in SENSOR_HEIGHT_M:
        raise ConversionError(f"DATA_CONFIG.DATASET: found {dataset!r}, expected one of {', '.join(SENSOR_HEIGHT_M)}, "
                              "or --sensor-height")
    return SENSOR_HEIGHT_M[dataset]


def _features(data):
    names = data.section("POINT_FEATURE_ENCODING").at("used_feature_list")
    unknown = [name for name in names if name not in FEATURES]
    if unknown:
        raise ConversionError(f"used_feature_list: found {unknown[0]!r}, expected some of {', '.join(FEATURES)}")
    features = [FEATURES[name] for name in names]
    if len(set(features)) != len(features):
        raise ConversionError(f"used_feature_list: found {names!r}, expected at most one that we do not have")
    return features


def _channels(backbone, head):
    channels = backbone.get("CHANNELS", [16, 32, 64, 128, 128])
    kernels = backbone.get("SPCONV_KERNEL_SIZES", [3, 3, 3, 3])
    if len(channels) != 5 or len(kernels) != 4 or channels[3] != channels[4]:
        raise ConversionError(f"BACKBONE_3D: found CHANNELS {channels!r} and kernels {kernels!r}, expected 5, of which "
                              "the last two are equal, and 4")
    # Stages 5 and 6 share the last entry of each.
    stages = [{"channels": channel, "blocks": 2, "kernel": kernel}
              for channel, kernel in zip([*channels, channels[4]], [3, *kernels, kernels[3]])]
    neck = backbone.get("OUT_CHANNEL", 128)
    expect(head.get("SHARED_CONV_CHANNEL", 128), neck, "SHARED_CONV_CHANNEL, of OUT_CHANNEL")
    return {"stages": stages, "neck_channels": neck, "head_kernel": head.get("KERNEL_SIZE_HEAD", 3)}


def _heads(root, head):
    known = root.at("CLASS_NAMES")
    heads = [[name for name in names if name in known] for names in head.at("CLASS_NAMES_EACH_HEAD")]
    expect(sorted(name for names in heads for name in names), sorted(known), "CLASS_NAMES_EACH_HEAD")
    if not all(heads):
        raise ConversionError(f"CLASS_NAMES_EACH_HEAD: found {heads!r}, expected a class in each")
    return heads


def _our_class(name, own):
    ours = own.get(name, CLASSES.get(name.lower()))
    if ours is None:
        raise ConversionError(f"CLASS_NAMES: found {name!r}, which is none we know, expected --class {name}=OURS")
    return ours


def _branches(head):
    expect(head.at("NUM_HM_CONV"), 2, "NUM_HM_CONV")
    found = head.section("SEPARATE_HEAD_CFG").at("HEAD_DICT")
    for name, layout in found.items():
        if name not in BRANCHES or name == "hm":
            raise ConversionError(f"HEAD_DICT: found {name!r}, expected some of {', '.join(BRANCHES)}")
        expect((layout["out_channels"], layout["num_conv"]), (BRANCHES[name], 2), f"HEAD_DICT.{name}")
    return [name for name in BRANCHES if name == "hm" or name in found]


def _rectifier(root, head, heads):
    if not head.get("IOU_BRANCH", False):
        return [0.0 for names in heads for _ in names]
    powers = head.at("RECTIFIER")
    known = root.at("CLASS_NAMES")
    if not isinstance(powers, list) or len(powers) != len(known):
        raise ConversionError(f"RECTIFIER: found {powers!r}, expected one for each of {known!r}")
    return [float(powers[known.index(name)]) for names in heads for name in names]


def _suppression(post):
    overlap = post.section("NMS_CONFIG").at("NMS_THRESH")
    # One figure for each class there, one for all boxes here: the strictest, since two things cannot overlap.
    overlap = min(overlap) if isinstance(overlap, list) else overlap
    return {"nms": "rotated", "nms_iou": float(overlap), "score_threshold": float(post.at("SCORE_THRESH"))}


# --- layers ----------------------------------------------------------------------------------------------------------


def layers_of(config):
    """[(our name, their convolution, their normalization or None, epsilon, kernel, dimensions, in, out)]."""
    layers = []

    def add(ours, theirs, norm, kernel, dimensions, channels_in, channels_out, epsilon=BACKBONE_EPSILON):
        layers.append((ours, theirs, norm, epsilon, kernel, dimensions, channels_in, channels_out))

    backbone = "backbone_3d."
    before = config["stages"][0]["channels"]
    add("input", backbone + "conv_input.0", backbone + "conv_input.1", 3, 3, len(config["features"]), before)
    for i, stage in enumerate(config["stages"], 1):
        theirs, channels = f"{backbone}conv{i}.", stage["channels"]
        if i > 1:
            add(f"stage{i}.down", theirs + "0.0", theirs + "0.1", stage["kernel"], 3, before, channels)
        for j in range(stage["blocks"]):
            block = f"{theirs}{j + (i > 1)}."
            add(f"stage{i}.block{j}.conv1", block + "conv1", block + "bn1", 3, 3, channels, channels)
            add(f"stage{i}.block{j}.conv2", block + "conv2", block + "bn2", 3, 3, channels, channels)
        before = channels
    neck = config["neck_channels"]
    add("neck.out", backbone + "conv_out.0", backbone + "conv_out.1", 3, 2, config["stages"][3]["channels"], neck)
    add("neck.shared", backbone + "shared_conv.0", backbone + "shared_conv.1", 3, 2, neck, neck, HEAD_EPSILON)
    for h, head in enumerate(config["heads"]):
        for branch in config["branches"]:
            theirs = f"dense_head.heads_list.{h}.{branch}."
            out = BRANCHES[branch] or len(head["classes"])
            add(f"head{h}.{branch}.0", theirs + "0.0", theirs + "0.1", config["head_kernel"], 2, neck, neck,
                HEAD_EPSILON)
            add(f"head{h}.{branch}.1", theirs + "1", None, 1, 2, neck, out)
    return layers


# The layouts of a sparse convolution's weight, as functions to [kernel..., in, out].
LAYOUTS = {
    "spconv 1": lambda weight: weight,  # [kernel..., in, out]
    "spconv 2, native": lambda weight: np.swapaxes(weight, -1, -2),  # [kernel..., out, in]
    "spconv 2": lambda weight: np.moveaxis(weight, 0, -1),  # [out, kernel..., in]
}


def layout_of(state, layers):
    """The one layout in which every layer has its shape; a checkpoint is written by one version of spconv."""
    fitting = []
    for name, turned in LAYOUTS.items():
        if all(turned(_tensor(state, theirs + ".weight")).shape == (*[kernel] * dimensions, c_in, c_out)
               for _, theirs, _, _, kernel, dimensions, c_in, c_out in layers):
            fitting.append(name)
    if len(fitting) == 1:
        return fitting[0]
    shapes = {theirs: _tensor(state, theirs + ".weight").shape for _, theirs, *_ in layers[:3]}
    raise ConversionError(f"weights: found shapes {shapes}, which fit {fitting or 'no layout'}, expected those of "
                          f"the YAML in one of {', '.join(LAYOUTS)}")


def _tensor(state, name):
    if name not in state:
        raise ConversionError(f"the checkpoint: found no {name}, which the YAML asks for")
    return state[name]


def converted(state, config):
    """Our tensors {name: float32} from OpenPCDet's state dict {name: array}.

    A normalization y = g (x - m) / sqrt(v + e) + b behind a convolution W, c becomes W g / sqrt(v + e) and
    (c - m) g / sqrt(v + e) + b, computed in double.
    """
    layers = layers_of(config)
    turned = LAYOUTS[layout_of(state, layers)]
    tensors, used = {}, {"global_step"}

    def vector(name, size):
        used.add(name)
        expect(_tensor(state, name).shape, (size,), name)
        return state[name].astype(np.float64)

    for ours, theirs, norm, epsilon, _, _, c_in, c_out in layers:
        used.add(theirs + ".weight")
        weight = turned(state[theirs + ".weight"]).astype(np.float64).reshape(-1, c_in, c_out)
        bias = vector(theirs + ".bias", c_out) if theirs + ".bias" in state else np.zeros(c_out)
        if norm is not None:
            scale = vector(norm + ".weight", c_out) / np.sqrt(vector(norm + ".running_var", c_out) + epsilon)
            bias = (bias - vector(norm + ".running_mean", c_out)) * scale + vector(norm + ".bias", c_out)
            weight = weight * scale
            used.add(norm + ".num_batches_tracked")
        tensors[ours + ".weight"] = weight.astype(np.float32)
        tensors[ours + ".bias"] = bias.astype(np.float32)
    left = sorted(set(state) - used)
    if left:
        raise ConversionError(f"the checkpoint: found {len(left)} tensors that the YAML does not ask for, the first "
                              f"{left[0]}")
    for name, tensor in tensors.items():
        if not np.isfinite(tensor).all():
            raise ConversionError(f"{name}: found a number that is not finite")
    return tensors
