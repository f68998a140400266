"""What the network should say, and how far from it it is (paper, section 3.2; CenterPoint for the
heat map). Departures: an object's size and heading are learned at every site near its centre, not
at the nearest alone, and each object counts as much as any other, however few sites it has (far ones have
few); rare classes of a head count more; the overlap of the boxes is learned besides their numbers;
objects with few points are neither right nor wrong."""

import torch

MIN_POINTS = 5
NEAR = 0.3  # heat above which a site learns the box


def cells(boxes, config):
    """Continuous place of the centres in the head's grid [M, 2] (x, y)."""
    stride = 8 * torch.tensor(config["voxel_m"][:2], device=boxes.device)
    return (boxes[:, :2] - torch.tensor(config["range_m"][:2], device=boxes.device)) / stride


def radius_of(boxes, config):
    """Gaussian radius in cells, so that boxes overlap by a tenth (CenterNet), at least 2."""
    size = boxes[:, 3:5] / (8 * config["voxel_m"][0])
    return torch.clamp((size.prod(1).sqrt() * 0.7), min=2.0)


def targets_of_scan(sites, boxes, classes, counts, head_classes, config):
    """@param sites [M, 2] (y, x). @return heat [M, C], weight [M] of the heat map, near [M] (box
    whose attributes the site learns, -1 = none), closeness [M]."""
    n, device = len(sites), sites.device
    heat = torch.zeros(n, len(head_classes), device=device)
    counted = torch.ones(n, len(head_classes), device=device)
    near = torch.full((n,), -1, dtype=torch.int64, device=device)
    closeness = torch.zeros(n, device=device)
    if not n or not len(boxes):
        return heat, counted, near, closeness
    place = sites.flip(1).float() + 0.5
    centres, radii = cells(boxes, config), radius_of(boxes, config)
    extent = torch.tensor([config["range_m"][3] - config["range_m"][0]], device=device)
    limit = extent / (8 * config["voxel_m"][0])
    for i, name in enumerate(classes):
        if name not in head_classes or not bool(((centres[i] >= 0) & (centres[i] < limit)).all()):
            continue
        c = head_classes.index(name)
        sigma = (2 * radii[i] + 1) / 6
        distance = ((place - centres[i]) ** 2).sum(1)
        nearest = distance.argmin()
        if counts[i] < MIN_POINTS or distance[nearest] > (radii[i] + 1) ** 2:
            counted[distance < (radii[i] + 1) ** 2] = 0.0
            continue
        from_nearest = ((place - place[nearest]) ** 2).sum(1)
        value = torch.exp(-from_nearest / (2 * sigma**2))
        value[value < 1e-2] = 0.0
        heat[:, c] = torch.maximum(heat[:, c], value)
        learns = (value > NEAR) & (value > closeness)
        near[learns] = i
        closeness[learns] = value[learns]
    return heat, counted, near, closeness


def box_targets(sites, boxes, config):
    """center, center_z, dim, rot of the box that belongs to each site."""
    return {"center": cells(boxes, config) - sites.flip(1).float(), "center_z": boxes[:, 2:3],
            "dim": boxes[:, 3:6].log(), "rot": torch.stack([(2 * boxes[:, 6]).cos(), (2 * boxes[:, 6]).sin()], 1)}


def decoded(result, sites, config):
    """Boxes [M, 7] of all sites. @param sites [M, 2] (y, x)."""
    stride = 8 * torch.tensor(config["voxel_m"][:2], device=sites.device)
    low = torch.tensor(config["range_m"][:2], device=sites.device)
    xy = (sites.flip(1) + result["center"]) * stride + low
    yaw = torch.atan2(result["rot"][:, 1], result["rot"][:, 0]) / 2
    return torch.cat([xy, result["center_z"], result["dim"].clamp(-5, 5).exp(), yaw[:, None]], 1)


def ground_plane_iou(a, b, samples=16):
    """IoU of pairs of rotated rectangles [M], by points sampled in both, to some 2 %."""
    steps = (torch.arange(samples, device=a.device) + 0.5) / samples - 0.5
    grid = torch.stack(torch.meshgrid(steps, steps, indexing="ij"), -1).reshape(1, -1, 2)

    def share(p, q):  # of p's area that lies in q
        corner = grid * p[:, None, 3:5]
        c, s = p[:, 6].cos()[:, None], p[:, 6].sin()[:, None]
        x = c * corner[..., 0] - s * corner[..., 1] + (p[:, 0] - q[:, 0])[:, None]
        y = s * corner[..., 0] + c * corner[..., 1] + (p[:, 1] - q[:, 1])[:, None]
        c, s = q[:, 6].cos()[:, None], q[:, 6].sin()[:, None]
        along, across = c * x + s * y, c * y - s * x
        hit = (along.abs() < q[:, 3:4] / 2) & (across.abs() < q[:, 4:5] / 2)
        return hit.float().mean(1)

    area_a, area_b = a[:, 3] * a[:, 4], b[:, 3] * b[:, 4]
    common = 0.5 * (share(a, b) * area_a + share(b, a) * area_b)
    return common / (area_a + area_b - common).clamp(min=1e-6)


def box_iou(a, b):
    """IoU of pairs of upright rotated boxes [M]."""
    plane = ground_plane_iou(a, b)
    area_a, area_b = a[:, 3] * a[:, 4], b[:, 3] * b[:, 4]
    common = plane * (area_a + area_b) / (1 + plane)
    top = torch.minimum(a[:, 2] + a[:, 5] / 2, b[:, 2] + b[:, 5] / 2)
    bottom = torch.maximum(a[:, 2] - a[:, 5] / 2, b[:, 2] - b[:, 5] / 2)
    common = common * (top - bottom).clamp(min=0)
    return common / (area_a * a[:, 5] + area_b * b[:, 5] - common).clamp(min=1e-6)


def overlap_if_parallel(a, b):
    """IoU of pairs of rectangles [M] from above if a had the heading of b; its gradient leads to b."""
    c, s = b[:, 6].cos(), b[:, 6].sin()
    d = a[:, :2] - b[:, :2]
    apart = torch.stack([c * d[:, 0] + s * d[:, 1], c * d[:, 1] - s * d[:, 0]], 1).abs()
    low, high = torch.minimum(a[:, 3:5], b[:, 3:5]), 0.5 * (a[:, 3:5] + b[:, 3:5])
    common = torch.minimum(low, high - apart).clamp(min=0).prod(1)
    return common / (a[:, 3:5].prod(1) + b[:, 3:5].prod(1) - common).clamp(min=1e-6)


def heat_loss(logits, heat, counted):
    """Focal loss of CenterNet, summed over sites, and the number of objects: by class [C]."""
    p = logits.sigmoid().clamp(1e-4, 1 - 1e-4)
    centre = (heat == 1).float() * counted
    of_centres = -(p.log() * (1 - p) ** 2 * centre)
    others = -((1 - p).log() * p**2 * (1 - heat) ** 4 * (1 - centre) * counted)
    return of_centres.sum(0) + others.sum(0), centre.sum(0)


def loss_of(results, sites, scans, config):
    """@param scans  (boxes [B, 7], class names, counts) of each scan.
    @return loss, and its parts as numbers."""
    parts = {"heat": 0.0, "box": 0.0, "rot": 0.0, "overlap": 0.0, "iou": 0.0}
    for head, result in zip(config["heads"], results):
        heats, counts, nears, weights, boxes = [], [], [], [], []
        for i, (scan_boxes, names, points) in enumerate(scans):
            rows = sites[:, 0] == i
            heat, counted, near, closeness = targets_of_scan(
                sites[rows][:, 1:], scan_boxes, names, points, head["classes"], config)
            heats.append(heat)
            counts.append(counted)
            nears.append(torch.where(near < 0, near, near + sum(len(b) for b in boxes)))
            weights.append(closeness)
            boxes.append(scan_boxes)
        heat, counted, near = torch.cat(heats), torch.cat(counts), torch.cat(nears)
        value, objects = heat_loss(result["hm"], heat, counted)
        # Halfway between a sum over the head's objects and one over each class's own.
        number = (objects.clamp(min=1.0) * objects.sum().clamp(min=1.0)).sqrt()
        parts["heat"] = parts["heat"] + (value / number).sum()
        rows = near >= 0
        if not bool(rows.any()):
            continue
        truth = torch.cat(boxes)[near[rows]]
        at, weight = sites[rows][:, 1:], torch.cat(weights)[rows]
        owner = near[rows]
        of_object = torch.zeros(int(owner.max()) + 1, device=owner.device).index_add(0, owner, weight)
        weight = weight / of_object[owner] / (of_object > 0).sum()
        wanted = box_targets(at, truth, config)
        said = {name: value[rows] for name, value in result.items()}
        for name in ("center", "center_z", "dim"):
            difference = (said[name] - wanted[name]).abs().sum(1)
            parts["box"] = parts["box"] + (difference * weight).sum()
        difference = (said["rot"] - wanted["rot"]).abs().sum(1)
        parts["rot"] = parts["rot"] + (difference * weight).sum()
        found = decoded(said, at, config)
        parts["overlap"] = parts["overlap"] + ((1 - overlap_if_parallel(found, truth)) * weight).sum()
        if "iou" in said:
            with torch.no_grad():
                iou = box_iou(found, truth)
            difference = (said["iou"][:, 0] - (2 * iou - 1)).abs()
            parts["iou"] = parts["iou"] + (difference * weight).sum()
    loss = (parts["heat"] + 0.5 * parts["box"] + 0.5 * parts["rot"] + 0.5 * parts["overlap"] +
            0.25 * parts["iou"])
    return loss, {name: float(value) for name, value in parts.items()}
