#include "evaluation/odometry/errors_json.hpp"

#include <cmath>

namespace stillmap::mapping {
namespace {

using Json = nlohmann::ordered_json;

Json figures_json(const ErrorFigures& figures) {
  return {{"mean", number_json(figures.mean)},
          {"rmse", number_json(figures.rmse)},
          {"median", number_json(figures.median)},
          {"max", number_json(figures.max)}};
}

Json kitti_json(const KittiErrors& kitti) {
  Json json{{"translation_percent", number_json(kitti.translation_percent)},
            {"rotation_deg_per_100m", number_json(kitti.rotation_deg_per_100m)},
            {"segments", kitti.segments}};
  json["lengths"] = Json::array();
  for (const LengthErrors& each : kitti.lengths)
    json["lengths"].push_back({{"length_m", each.length_m},
                               {"segments", each.segments},
                               {"translation_percent", number_json(each.translation_percent)},
                               {"rotation_deg_per_100m", number_json(each.rotation_deg_per_100m)}});
  return json;
}

}  // namespace

Json number_json(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }

Json errors_json(const TrajectoryErrors& errors) {
  const RelativeErrors& relative = errors.relative;
  return {{"kitti", kitti_json(errors.kitti)},
          {"ape_mean_m", number_json(errors.aligned_m.mean)},
          {"ate_rmse_m", number_json(errors.aligned_m.rmse)},
          {"rpe",
           {{"translation_percent_10m", number_json(relative.translation_percent_10m)},
            {"rotation_deg_10m", number_json(relative.rotation_deg_10m)},
            {"segments_10m", relative.segments_10m},
            {"next_translation_m", figures_json(relative.step_translation_m)},
            {"next_rotation_deg", figures_json(relative.step_rotation_deg)}}},
          {"distance_aligned_m", figures_json(errors.aligned_m)},
          {"distance_from_start_m", figures_json(errors.from_start_m)},
          {"poses", errors.poses},
          {"way_m", number_json(errors.way_m)}};
}

}  // namespace stillmap::mapping
