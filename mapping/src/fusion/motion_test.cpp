#include "fusion/motion_test.hpp"

#include "fusion/box_estimate.hpp"

#include <algorithm>

namespace stillmap::mapping {
namespace {

constexpr std::size_t kMaxWindows = 16;
/// A parked car's box jumps by up to 2 m between the corners that are seen.
constexpr double kMovedSigmas = 4.5;
/// Tracks whose places nobody saw again must at least be this long.
constexpr std::size_t kMinHitsUnseen = 4;

}  // namespace

MotionTest::MotionTest(const Track& track) : track_(track) {
  find_ends(windows());
  least_m_ = kMovedSigmas * centre_sigma_m(class_of(track.hits));
  length_m_ = size_of(track.hits).x();
  if (farthest_m_ > least_m_ && !track.given) boxes_ = {box_of(early_), box_of(late_)};
}

std::vector<MotionTest::Window> MotionTest::windows() const {
  const Eigen::Vector3d size_m = size_of(track_.hits);
  const std::size_t n = track_.hits.size();
  const std::size_t width =
      std::max<std::size_t>({1, std::min<std::size_t>(5, n / 3), n / kMaxWindows});
  std::vector<Window> windows;
  for (std::size_t begin = 0; begin + width <= n; begin += width) {
    std::vector<std::pair<double, double>> x, y;
    for (std::size_t i = begin; i < begin + width; ++i) {
      const Eigen::Vector2d centre = aligned_centre(track_.hits[i], size_m);
      x.emplace_back(centre.x(), 1.0);
      y.emplace_back(centre.y(), 1.0);
    }
    windows.push_back(
        {begin, begin + width, {weighted_quantile(x, 0.5), weighted_quantile(y, 0.5)}});
  }
  return windows;
}

void MotionTest::find_ends(const std::vector<Window>& windows) {
  early_ = late_ = windows.front();
  for (std::size_t i = 0; i < windows.size(); ++i) {
    for (std::size_t j = i + 1; j < windows.size(); ++j) {
      const double distance_m = (windows[i].centre - windows[j].centre).norm();
      if (!(distance_m > farthest_m_)) continue;
      farthest_m_ = distance_m;
      early_ = windows[i];
      late_ = windows[j];
    }
  }
}

maps::Box MotionTest::box_of(const Window& window) const {
  const auto begin = track_.hits.begin();
  return standing_box({begin + static_cast<std::ptrdiff_t>(window.begin),
                       begin + static_cast<std::ptrdiff_t>(window.end)});
}

std::vector<PlaceQuestion> MotionTest::questions() const {
  std::vector<PlaceQuestion> questions;
  if (boxes_.empty()) return questions;
  for (std::size_t i = late_.begin; i < late_.end; ++i)
    questions.push_back({track_.hits[i].scan, &boxes_[0]});
  for (std::size_t i = early_.begin; i < early_.end; ++i)
    questions.push_back({track_.hits[i].scan, &boxes_[1]});
  return questions;
}

bool MotionTest::moved(std::span<const PlaceLook> answers) const {
  if (!(farthest_m_ > least_m_)) return false;
  if (track_.given) return true;
  int free = 0;
  for (const PlaceLook& look : answers) {
    if (look.state == PlaceState::kFree) ++free;
    if (look.state == PlaceState::kOccupied) --free;
  }
  if (free != 0) return free > 0;
  return track_.hits.size() >= kMinHitsUnseen && farthest_m_ > length_m_;
}

}  // namespace stillmap::mapping
