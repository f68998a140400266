#include "evaluation/detector/box_matching.hpp"

#include "fusion/box_frames.hpp"

#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <numeric>
#include <optional>
#include <tuple>

namespace stillmap::mapping {
namespace {

/// Corners nearer than this to the camera have no place in the image [m].
constexpr double kNearestDepthM = 0.1;

/// Classes of truth on which a box is neither right nor wrong.
bool may_be(const ClassGroup& group, maps::ObjectClass object_class) {
  return group.holds(object_class) || object_class == maps::ObjectClass::kUnknown;
}

double centre_distance_m(const maps::Box& a, const maps::Box& b) {
  return (a.centre - b.centre).head<2>().norm();
}

bool is_over(const maps::Box& footprint, const Eigen::Vector3d& p) {
  return footprint.contains({p.x(), p.y(), footprint.centre.z()});
}

/// What both ways to match begin with.
ScanMatch begin_match(const ScanBoxes& boxes, const ClassGroup& group, const Window& window,
                      double min_score) {
  ScanMatch match;
  for (const TruthBox& truth : boxes.truths) {
    const bool counts = group.holds(truth.box.object_class) && window.counts(truth);
    match.counts.push_back(counts ? 1 : 0);
  }
  match.is_found.assign(boxes.truths.size(), 0);
  for (const maps::Box& box : boxes.found) {
    const bool judged = group.holds(box.object_class) && box.score >= min_score;
    match.verdicts.push_back(judged ? Verdict::kFalse : Verdict::kOther);
  }
  return match;
}

/// Whether a box that found nothing says nothing.
template <typename Near>
bool is_ignored(const ScanBoxes& boxes, const ScanMatch& match, std::size_t found,
                const ClassGroup& group, const Window& window, const Near& near) {
  const maps::Box& box = boxes.found[found];
  if (boxes.in_sight[found] == 0 || !window.holds(box)) return true;
  for (std::size_t i = 0; i < boxes.truths.size(); ++i) {
    const maps::Box& truth = boxes.truths[i].box;
    if (match.counts[i] != 0 || !may_be(group, truth.object_class)) continue;
    if (is_over(truth, box.centre) || near(truth, box)) return true;
  }
  return false;
}

template <typename Near>
void ignore_what_says_nothing(const ScanBoxes& boxes, const ClassGroup& group, const Window& window,
                              const Near& near, ScanMatch& match) {
  for (std::size_t i = 0; i < boxes.found.size(); ++i) {
    if (match.verdicts[i] == Verdict::kFalse && is_ignored(boxes, match, i, group, window, near))
      match.verdicts[i] = Verdict::kIgnored;
  }
}

/// The part of the image that a box covers; edges that pass the camera end where they are seen.
std::optional<maps::ImageRectangle> outline_of(const maps::Box& box, const maps::CameraView& view) {
  const Eigen::AngleAxisd turned(box.yaw_rad, Eigen::Vector3d::UnitZ());
  Eigen::AlignedBox2d outline;
  for (unsigned i = 0; i < 8; ++i) {
    const Eigen::Vector3d side((i & 1U) != 0 ? 0.5 : -0.5, (i & 2U) != 0 ? 0.5 : -0.5,
                               (i & 4U) != 0 ? 0.5 : -0.5);
    const Eigen::Vector3d corner = box.centre + turned * side.cwiseProduct(box.size_m);
    const Eigen::Vector3d h = view.P_image_lidar * corner.homogeneous();
    if (h.z() >= kNearestDepthM) outline.extend(Eigen::Vector2d(h.head<2>() / h.z()));
  }
  const Eigen::AlignedBox2d image(Eigen::Vector2d::Zero(), view.size_px);
  const Eigen::AlignedBox2d seen = outline.intersection(image);
  if (seen.isEmpty()) return std::nullopt;
  return maps::ImageRectangle{seen.min().x(), seen.min().y(), seen.max().x(), seen.max().y()};
}

double shared_area_px2(const maps::ImageRectangle& a, const maps::ImageRectangle& b) {
  const double width = std::min(a.right, b.right) - std::max(a.left, b.left);
  const double height = std::min(a.bottom, b.bottom) - std::max(a.top, b.top);
  return std::max(0.0, width) * std::max(0.0, height);
}

}  // namespace

bool Window::holds(const maps::Box& box) const {
  const double range_m = box.centre.head<2>().norm();
  return range_m >= from_m && range_m < to_m;
}

bool Window::counts(const TruthBox& truth) const {
  return truth.points >= min_points && holds(truth.box);
}

ScanMatch match_by_overlap(const ScanBoxes& boxes, const ClassGroup& group, const Window& window,
                           double min_iou) {
  ScanMatch match = begin_match(boxes, group, window, 0.0);
  std::vector<std::size_t> order(boxes.found.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return boxes.found[a].score > boxes.found[b].score;
  });
  for (const std::size_t found : order) {
    if (match.verdicts[found] != Verdict::kFalse) continue;
    double best_iou = 0.0;
    std::size_t best = boxes.truths.size();
    for (std::size_t i = 0; i < boxes.truths.size(); ++i) {
      if (match.counts[i] == 0 || match.is_found[i] != 0) continue;
      const double iou = overlap_of(boxes.truths[i].box, boxes.found[found]).of_joint;
      if (iou >= min_iou && iou > best_iou) {
        best_iou = iou;
        best = i;
      }
    }
    if (best == boxes.truths.size()) continue;
    match.is_found[best] = 1;
    match.verdicts[found] = Verdict::kTrue;
  }
  ignore_what_says_nothing(
      boxes, group, window,
      [&](const maps::Box& a, const maps::Box& b) { return overlap_of(a, b).of_joint >= min_iou; },
      match);
  return match;
}

ScanMatch match_by_centre(const ScanBoxes& boxes, const ClassGroup& group, const Window& window,
                          double min_score) {
  ScanMatch match = begin_match(boxes, group, window, min_score);
  std::vector<std::tuple<double, std::size_t, std::size_t>> pairs;
  for (std::size_t truth = 0; truth < boxes.truths.size(); ++truth) {
    for (std::size_t found = 0; found < boxes.found.size(); ++found) {
      if (match.counts[truth] == 0 || match.verdicts[found] != Verdict::kFalse) continue;
      const double distance_m = centre_distance_m(boxes.truths[truth].box, boxes.found[found]);
      if (distance_m <= kCentreReachM) pairs.emplace_back(distance_m, truth, found);
    }
  }
  std::sort(pairs.begin(), pairs.end());
  for (const auto& [distance_m, truth, found] : pairs) {
    if (match.is_found[truth] != 0 || match.verdicts[found] == Verdict::kTrue) continue;
    match.is_found[truth] = 1;
    match.verdicts[found] = Verdict::kTrue;
  }
  ignore_what_says_nothing(
      boxes, group, window,
      [](const maps::Box& a, const maps::Box& b) {
        return centre_distance_m(a, b) <= kCentreReachM;
      },
      match);
  return match;
}

bool would_be_labelled(const maps::Box& box, const maps::CameraView& view) {
  const Eigen::Vector3d h = view.P_image_lidar * box.centre.homogeneous();
  if (!(h.z() >= kNearestDepthM)) return false;
  const Eigen::Vector2d pixel = h.head<2>() / h.z();
  const bool in_image =
      (pixel.array() >= 0.0).all() && (pixel.array() < view.size_px.array()).all();
  if (!in_image) return false;
  const std::optional<maps::ImageRectangle> outline = outline_of(box, view);
  return outline &&
         std::none_of(view.dont_care.begin(), view.dont_care.end(),
                      [&](const maps::ImageRectangle& region) {
                        return shared_area_px2(*outline, region) >= 0.5 * outline->area();
                      });
}

}  // namespace stillmap::mapping
