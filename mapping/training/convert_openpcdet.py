#!/usr/bin/env python3
"""Turns an OpenPCDet VoxelNeXt checkpoint into the weights file of `stillmap build --detector voxelnext:FILE`.

usage: convert_openpcdet.py CHECKPOINT.pth CONFIG.yaml -o OUT.safetensors
                            [--name NAME] [--class THEIRS=OURS]... [--sensor-height METRES]
                            [--range X_MIN Y_MIN Z_MIN X_MAX Y_MAX Z_MAX] [--half]

CONFIG.yaml lies in the tools/ of OpenPCDet, so that the YAML it is based on is found. Needs python3-numpy and
python3-yaml; nothing of the checkpoint is executed (torch_checkpoint.py). What differs from OpenPCDet afterwards:
means run over all points of a voxel (there at most MAX_POINTS_PER_VOXEL), time stamps and elongation are 0,
overlapping boxes are thinned over all classes together with the smallest NMS_THRESH, and MAX_OBJ_PER_SAMPLE and
POST_CENTER_LIMIT_RANGE are not used. Exit code 1, with one line, where something does not fit.
"""

import argparse
import json
import pathlib
import sys

import numpy as np

import openpcdet
import safetensors
import torch_checkpoint


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("checkpoint", type=pathlib.Path)
    parser.add_argument("config", type=pathlib.Path, help="YAML in the tools/ of OpenPCDet")
    parser.add_argument("-o", "--output", type=pathlib.Path, required=True)
    parser.add_argument("--name", help="of the network, in manifests (default: of the YAML)")
    parser.add_argument("--class", dest="classes", action="append", default=[], metavar="THEIRS=OURS",
                        help='an object class of ours, or nothing: "THEIRS=" drops its boxes')
    parser.add_argument("--sensor-height", type=float, metavar="METRES",
                        help="of the network's z = 0 over the road (default: by the data set)")
    parser.add_argument("--range", type=float, nargs=6, metavar="METRES",
                        help="x y z minima, then maxima (default: of the YAML); a sparse network runs on any, and "
                             "Argoverse 2's own is too large for the program")
    parser.add_argument("--half", action="store_true", help="half-precision numbers, half the size")
    return parser.parse_args()


def own_classes(given):
    ours = {}
    for text in given:
        theirs, equals, name = text.partition("=")
        if not equals or name not in {*openpcdet.CLASSES.values()}:
            known = sorted(set(openpcdet.CLASSES.values()) - {""})
            raise openpcdet.ConversionError(f"--class: found {text!r}, expected THEIRS=OURS with one of "
                                            f"{', '.join(known)} or nothing")
        ours[theirs] = name
    return ours


def halved(tensors):
    halves = {name: tensor.astype(np.float16) for name, tensor in tensors.items()}
    for name, half in halves.items():
        if not np.isfinite(half).all():
            raise openpcdet.ConversionError(f"{name}: found a number beyond 65504, expected none with --half")
    return halves


def convert(options):
    config = openpcdet.config_of(openpcdet.read_yaml(options.config), options.name or options.config.stem,
                                 own_classes(options.classes), options.sensor_height)
    if options.range:
        config["range_m"] = options.range
    tensors = openpcdet.converted(torch_checkpoint.load_state_dict(options.checkpoint), config)
    if options.half:
        tensors = halved(tensors)
    safetensors.save(options.output, tensors,
                     {"format": "stillmap-voxelnext", "version": "1", "config": json.dumps(config)})
    numbers = sum(tensor.size for tensor in tensors.values())
    print(f"{options.output}: {config['name']}, {len(tensors) // 2} layers, {numbers} numbers")


def main():
    try:
        # A number too large for half precision is reported by name instead.
        with np.errstate(over="ignore"):
            convert(arguments())
    except (openpcdet.ConversionError, torch_checkpoint.CheckpointError, safetensors.SafetensorsError, OSError,
            openpcdet.yaml.YAMLError) as error:
        print(f"convert_openpcdet: {' '.join(str(error).split())}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
