"""Detections on held-out scans, and average precision: BEV IoU 0.5 for vehicles, 0.3 for others,
40 recall points (KITTI); truths with fewer than 5 points or beyond the range count for nothing."""

import losses
import numpy as np
import scans as scan_files
import torch

VEHICLES = ("car", "van", "truck", "bus")


def detect(net, features, sites, config, threshold=0.1, limit=300):
    """@return boxes [N, 7], scores [N], class names of one scan, after non-maximum suppression."""
    with torch.no_grad():
        results, places = net(features, sites)
    boxes, scores, names = [], [], []
    flat = 0
    for head, result in zip(config["heads"], results):
        box = losses.decoded(result, places[:, 1:], config)
        for c, name in enumerate(head["classes"]):
            scale, shift = config["calibration"][flat]
            p = (scale * result["hm"][:, c] + shift).sigmoid()
            if "iou" in result:
                a = config["iou_rectifier"][flat]
                p = p ** (1 - a) * ((result["iou"][:, 0] + 1) / 2).clamp(1e-4, 1) ** a
            flat += 1
            keep = p >= threshold
            boxes.append(box[keep])
            scores.append(p[keep])
            names += [name] * int(keep.sum())
    boxes, scores = torch.cat(boxes), torch.cat(scores)
    order = scores.argsort(descending=True)[:limit]
    return suppressed(boxes[order], scores[order], [names[i] for i in order], config["nms_iou"])


def suppressed(boxes, scores, names, limit):
    kept = []
    for i in range(len(boxes)):
        if kept:
            others = boxes[kept]
            near = (others[:, :2] - boxes[i, :2]).norm(dim=1) < 12.0
            if bool(near.any()):
                one = boxes[i:i + 1].expand(int(near.sum()), 7)
                if float(losses.ground_plane_iou(one, others[near], 12).max()) > limit:
                    continue
        kept.append(i)
    return boxes[kept], scores[kept], [names[i] for i in kept]


def matched(boxes, scores, truth, counted, iou):
    """(score, is true) of each detection that counts, and the number of truths that count."""
    taken = np.zeros(len(truth), bool)
    marks = []
    for i in range(len(boxes)):
        best, best_iou = -1, iou
        if len(truth):
            near = ((truth[:, :2] - boxes[i, :2]).norm(dim=1) < 8.0).nonzero()[:, 0]
            if len(near):
                values = losses.ground_plane_iou(boxes[i:i + 1].expand(len(near), 7), truth[near], 24)
                for j, value in zip(near.tolist(), values.tolist()):
                    if not taken[j] and value >= best_iou:
                        best, best_iou = j, value
        if best >= 0:
            taken[best] = True
            if counted[best]:
                marks.append((float(scores[i]), True))
        else:
            marks.append((float(scores[i]), False))
    return marks, int(counted.sum())


def average_precision(marks, truths):
    if not truths:
        return float("nan")
    marks = sorted(marks, reverse=True)
    true = np.cumsum([m[1] for m in marks]) if marks else np.zeros(0)
    precision = true / np.arange(1, len(marks) + 1)
    recall = true / truths
    return float(np.mean([precision[recall >= r].max(initial=0.0)
                          for r in np.arange(1, 41) / 40]))


def in_group(name, group):
    return name in VEHICLES if group == "vehicle" else name == group


def evaluate(net, dataset, config, range_m=50.0, threshold=0.1):
    """AP by group, over scans (points, boxes, names, counts)."""
    net.eval()
    groups = {"vehicle": 0.5, "car": 0.5, "pedestrian": 0.3, "cyclist": 0.3}
    marks, truths = {g: [] for g in groups}, {g: 0 for g in groups}
    false = 0
    for scan in dataset:
        features, sites = scan_files.voxels(scan.points, config)
        sites = torch.cat([torch.zeros(len(sites), 1, dtype=torch.int64), torch.tensor(sites)], 1)
        boxes, scores, names = detect(net, torch.tensor(features), sites, config, threshold)
        inside = boxes[:, :2].norm(dim=1) < range_m
        truth = torch.tensor(scan.boxes)
        truth_names = [scan_files.LEARNED.get(scan_files.OBJECT_CLASSES[c], "") for c in scan.classes]
        countable = (scan.counts() >= losses.MIN_POINTS) & (truth[:, :2].norm(dim=1).numpy() < range_m)
        for group, iou in groups.items():
            mine = [i for i, n in enumerate(names) if in_group(n, group) and inside[i]]
            theirs = [i for i, n in enumerate(truth_names) if in_group(n, group)]
            found, n = matched(boxes[mine], scores[mine], truth[theirs], countable[theirs], iou)
            marks[group] += found
            truths[group] += n
            if group == "vehicle":
                false += sum(1 for score, good in found if not good and score > 0.3)
    figures = {g: round(average_precision(marks[g], truths[g]), 4) for g in groups}
    figures["false_vehicles_per_scan_at_0.3"] = round(false / max(1, len(dataset)), 2)
    vehicle = [m for m in marks["vehicle"] if m[0] > 0.3]
    figures["vehicle_recall_at_0.3"] = round(sum(m[1] for m in vehicle) / max(1, truths["vehicle"]), 4)
    net.train()
    return figures
