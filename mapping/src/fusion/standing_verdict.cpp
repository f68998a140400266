#include "fusion/standing_verdict.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <utility>

namespace stillmap::mapping {
namespace {

/// Accepted from here on. Losing a wall costs more than keeping a car.
constexpr double kLeastLogOdds = 1.0;

bool is_vehicle(maps::ObjectClass object_class) {
  using maps::ObjectClass;
  switch (object_class) {
    case ObjectClass::kCar:
    case ObjectClass::kVan:
    case ObjectClass::kTruck:
    case ObjectClass::kBus:
    case ObjectClass::kTrailer:
    case ObjectClass::kTram:
    case ObjectClass::kUnknown:
      return true;
    case ObjectClass::kMotorcycle:
    case ObjectClass::kCyclist:
    case ObjectClass::kPedestrian:
      return false;
  }
  return false;
}

double within(double value, double low, double high) { return std::clamp(value, low, high); }

/// Takes those that `goes` holds of out of one list and puts them into another.
template <typename Goes>
std::vector<FusedObject> split(std::vector<FusedObject>& objects, const Goes& goes) {
  const auto first = std::stable_partition(objects.begin(), objects.end(),
                                           [&](const FusedObject& each) { return !goes(each); });
  std::vector<FusedObject> gone(std::make_move_iterator(first),
                                std::make_move_iterator(objects.end()));
  objects.erase(first, objects.end());
  return gone;
}

}  // namespace

double vehicle_log_odds(const FusedObject& object, const StandingShape& shape) {
  if (!is_vehicle(object.object_class) || shape.voxels == 0)
    return -std::numeric_limits<double>::infinity();
  const double p = within(object.existence, 0.03, 0.97);
  const auto detections =
      static_cast<double>(std::count_if(object.placements.begin(), object.placements.end(),
                                        [](const ObjectPlacement& each) { return each.detected; }));
  const Eigen::Vector3d& size = object.size_m;
  // Weights of a logistic regression over some thousand candidates in 15 simulated drives with
  // three sensors, each drive judged by the others'; see the folder's README.
  return -3.66 + 0.33 * std::log(p / (1.0 - p)) + 0.49 * std::log(within(detections, 1.0, 30.0)) +
         // Sheet metal is flat, leaves are not.
         10.5 * within(shape.planarity, 0.4, 0.85) -
         // Walls, trunks and hedges under trees go on above.
         5.6 * shape.tall_share -
         // Below a body there is air between the wheels; walls, bins and hedges stand on the
         // ground.
         8.8 * shape.skirt_share -
         // Cars are 1.8 m wide, 3.5 to 5.3 m long and lower than 2 m.
         1.4 * within(std::abs(size.y() - 1.8), 0.0, 1.0) -
         0.5 * within(std::abs(size.x() - 4.4) - 0.5, 0.0, 2.0) -
         2.2 * within(size.z() - 2.0, 0.0, 1.0);
}

void judge_standing(FusedObjects& fused, const ObstacleMap& obstacles,
                    const Eigen::Vector3d& origin) {
  const auto refused = [&](const FusedObject& object) {
    if (object.moving) return false;
    maps::Box box = object.placements.front().box;
    box.centre -= origin;
    return vehicle_log_odds(object, shape_of(obstacles, box)) < kLeastLogOdds;
  };
  std::vector<FusedObject> gone = split(fused.objects, refused);
  std::vector<FusedObject> come = split(
      fused.doubtful, [&](const FusedObject& each) { return !each.moving && !refused(each); });
  std::move(gone.begin(), gone.end(), std::back_inserter(fused.doubtful));
  std::move(come.begin(), come.end(), std::back_inserter(fused.objects));
  std::stable_sort(fused.objects.begin(), fused.objects.end(),
                   [](const FusedObject& a, const FusedObject& b) {
                     return a.placements.front().scan < b.placements.front().scan;
                   });
  number_objects(fused.objects);
}

}  // namespace stillmap::mapping
