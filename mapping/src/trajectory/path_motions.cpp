#include "trajectory/path_motions.hpp"

namespace stillmap::mapping {
namespace {

/// Motions last so long, or twice the box.
constexpr double kLeastMotionS = 1.0;
constexpr std::size_t kMostMotions = 800;

}  // namespace

PathMotions motions_of(const std::vector<SmoothPath::Pose>& poses, double box_s, double step_s) {
  const SmoothPath path(poses, box_s);
  const std::size_t stride = (poses.size() + kMostMotions - 1) / kMostMotions;
  PathMotions motions{.length_s = std::max(kLeastMotionS, 2.0 * box_s),
                      .box_s = box_s,
                      .aside_s = 0.25 * box_s,
                      .apart_s = static_cast<double>(stride) * step_s,
                      .all = {}};
  for (std::size_t i = 0; i < poses.size(); i += stride) {
    const double t_s = poses[i].t_s;
    const auto seen = [&](double aside_s) {
      return path.motion(t_s + aside_s, t_s + aside_s + motions.length_s, true);
    };
    const auto T = seen(0.0), earlier = seen(-motions.aside_s), later = seen(motions.aside_s);
    if (T && earlier && later) motions.all.push_back({t_s, *T, *earlier, *later});
  }
  return motions;
}

}  // namespace stillmap::mapping
