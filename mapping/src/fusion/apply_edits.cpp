#include "fusion/apply_edits.hpp"

#include "fusion/track.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <stdexcept>
#include <utility>

namespace stillmap::mapping {
namespace {

/// A rebuild with other options moves an object by less [m].
constexpr double kPlaceM = 1.0;
/// As far as scans count for objects in the first place [m].
constexpr double kEditReachM = 80.0;

bool in_scope(const ObjectPlacement& placement, const maps::Edit& edit,
              const std::vector<EditScan>& scans) {
  const EditScan& scan = scans[placement.scan];
  return edit.scope.holds(scan.drive, scan.index);
}

/// Whether an edit means this object.
bool means(const FusedObject& object, const maps::Edit& edit, const std::vector<EditScan>& scans) {
  if (!may_be_one(object.object_class, edit.object->object_class)) return false;
  return std::any_of(object.placements.begin(), object.placements.end(),
                     [&](const ObjectPlacement& placement) {
                       return (placement.box.centre - edit.object->centre).norm() < kPlaceM &&
                              in_scope(placement, edit, scans);
                     });
}

/// Indices of the objects that an edit means; those that moved only when none stood there.
std::vector<std::size_t> meant(const std::vector<FusedObject>& objects, const maps::Edit& edit,
                               const std::vector<EditScan>& scans) {
  std::vector<std::size_t> standing, moving;
  for (std::size_t i = 0; i < objects.size(); ++i) {
    if (means(objects[i], edit, scans)) (objects[i].moving ? moving : standing).push_back(i);
  }
  return standing.empty() ? moving : standing;
}

/// Takes the placements for which `goes` holds out of an object.
template <typename Goes>
void take_out(FusedObject& object, const Goes& goes, std::vector<FusedObject>& kept) {
  FusedObject taken = object;
  std::erase_if(taken.placements, [&](const ObjectPlacement& p) { return !goes(p); });
  if (taken.placements.empty()) return;
  std::erase_if(object.placements, goes);
  kept.push_back(std::move(taken));
}

bool keep_object(FusedObjects& fused, const maps::Edit& edit, const std::vector<EditScan>& scans,
                 std::vector<FusedObject>& kept) {
  const std::vector<std::size_t> indices = meant(fused.objects, edit, scans);
  for (const std::size_t i : indices) {
    take_out(
        fused.objects[i], [&](const ObjectPlacement& p) { return in_scope(p, edit, scans); }, kept);
  }
  return !indices.empty();
}

bool keep_region(FusedObjects& fused, const maps::Edit& edit, const std::vector<EditScan>& scans,
                 std::vector<FusedObject>& kept) {
  for (FusedObject& object : fused.objects) {
    take_out(
        object,
        [&](const ObjectPlacement& p) {
          return edit.box->contains(p.box.centre) && in_scope(p, edit, scans);
        },
        kept);
  }
  // It holds for points too, so it meets something wherever a scan was near.
  const double reach_m = kEditReachM + 0.5 * edit.box->size_m.norm();
  return std::any_of(scans.begin(), scans.end(), [&](const EditScan& scan) {
    return edit.scope.holds(scan.drive, scan.index) &&
           (scan.sensor - edit.box->centre).norm() < reach_m;
  });
}

bool remove_object(FusedObjects& fused, const maps::Edit& edit,
                   const std::vector<EditScan>& scans) {
  if (!meant(fused.objects, edit, scans).empty()) return true;
  const std::vector<std::size_t> indices = meant(fused.doubtful, edit, scans);
  for (const std::size_t i : indices) {
    FusedObject object = fused.doubtful[i];
    std::erase_if(object.placements, [&](const ObjectPlacement& placement) {
      return !in_scope(placement, edit, scans);
    });
    object.existence = 1.0;
    fused.objects.push_back(std::move(object));
  }
  return !indices.empty();
}

bool remove_region(FusedObjects& fused, const maps::Edit& edit,
                   const std::vector<EditScan>& scans) {
  const double reach_m = kEditReachM + 0.5 * edit.box->size_m.norm();
  // Objects are of one drive.
  std::map<std::size_t, FusedObject> by_drive;
  for (std::size_t i = 0; i < scans.size(); ++i) {
    if (!edit.scope.holds(scans[i].drive, scans[i].index) ||
        (scans[i].sensor - edit.box->centre).norm() >= reach_m)
      continue;
    FusedObject& object = by_drive[scans[i].drive_number];
    object.size_m = edit.box->size_m;
    object.existence = 1.0;
    object.placements.push_back({i, *edit.box, false});
  }
  for (auto& [drive, object] : by_drive) fused.objects.push_back(std::move(object));
  return !by_drive.empty();
}

bool apply(FusedObjects& fused, const maps::Edit& edit, const std::vector<EditScan>& scans,
           std::vector<FusedObject>& kept) {
  if (edit.action == maps::EditAction::kKeep)
    return edit.box ? keep_region(fused, edit, scans, kept) : keep_object(fused, edit, scans, kept);
  return edit.box ? remove_region(fused, edit, scans) : remove_object(fused, edit, scans);
}

void check(const std::vector<FusedObject>& objects, std::size_t scans) {
  for (const FusedObject& object : objects) {
    for (const ObjectPlacement& placement : object.placements) {
      if (placement.scan >= scans)
        throw std::invalid_argument(
            fmt::format("placement: scan {}, expected below {}", placement.scan, scans));
    }
  }
}

}  // namespace

EditResult apply_edits(FusedObjects& fused, const maps::Edits& edits,
                       const std::vector<EditScan>& scans) {
  check(fused.objects, scans.size());
  check(fused.doubtful, scans.size());
  EditResult result;
  for (std::size_t i = 0; i < edits.size(); ++i) {
    if (apply(fused, edits[i], scans, result.kept)) {
      ++result.applied;
    } else {
      result.unmatched.push_back(fmt::format("edits[{}]: {}", i, edits[i].description()));
    }
  }
  std::erase_if(fused.objects, [](const FusedObject& object) { return object.placements.empty(); });
  order_objects(fused.objects);
  return result;
}

std::vector<maps::Box> kept_regions(const maps::Edits& edits, const EditScan& scan) {
  std::vector<maps::Box> regions;
  for (const maps::Edit& edit : edits) {
    if (edit.action == maps::EditAction::kKeep && edit.box &&
        edit.scope.holds(scan.drive, scan.index))
      regions.push_back(*edit.box);
  }
  return regions;
}

}  // namespace stillmap::mapping
