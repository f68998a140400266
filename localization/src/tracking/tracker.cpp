#include <stillmap/localization/tracker.hpp>

#include "align/input_checks.hpp"
#include "session.hpp"

#include <fmt/format.h>

#include <stdexcept>
#include <utility>

namespace stillmap::localization {
namespace {

/// Beyond these sums of squares would no longer be finite everywhere [m].
constexpr double kMaxCoordinateM = 1e9;
constexpr double kMaxMotionM = 1e5;
constexpr double kMaxVariance = 1e12;
constexpr double kRotationTolerance = 1e-3;

void require_rigid(const char* name, const Eigen::Isometry3d& T, double max_m) {
  const Eigen::Matrix3d& R = T.linear();
  const bool rigid = T.matrix().allFinite() &&
                     (R.transpose() * R - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() <
                         kRotationTolerance &&
                     R.determinant() > 0.0;
  if (!rigid || !(T.translation().cwiseAbs().maxCoeff() <= max_m)) {
    throw std::invalid_argument(
        fmt::format("{}: found no rigid motion within {:g} m, expected one", name, max_m));
  }
}

void require_covariance(const char* name, const Matrix6d& covariance) {
  const bool bounded = covariance.allFinite() && covariance.cwiseAbs().maxCoeff() <= kMaxVariance;
  const bool symmetric = bounded && covariance.isApprox(covariance.transpose(), 1e-6);
  if (!symmetric || !is_positive_definite(covariance)) {
    throw std::invalid_argument(
        fmt::format("{}: its covariance is not symmetric, positive definite and up to {:g}", name,
                    kMaxVariance));
  }
}

}  // namespace

std::string_view name_of(SearchedFrom from) {
  switch (from) {
    case SearchedFrom::kEverywhere:
      return "everywhere";
    case SearchedFrom::kGiven:
      return "given";
    case SearchedFrom::kVelocity:
      return "velocity";
    case SearchedFrom::kOdometry:
      return "odometry";
    case SearchedFrom::kInterpolation:
      return "interpolation";
    case SearchedFrom::kNowhere:
      return "nowhere";
  }
  throw std::invalid_argument(fmt::format("SearchedFrom: {}, unknown", static_cast<int>(from)));
}

Tracker::Tracker(std::shared_ptr<const Aligner> aligner, const TrackerOptions& options) {
  if (!aligner) throw std::invalid_argument("tracker: no aligner");
  if (const auto violations = options.violations(); !violations.empty()) {
    throw std::invalid_argument(fmt::format("{}", fmt::join(violations, "; ")));
  }
  session_ = std::make_unique<TrackingSession>(std::move(aligner), options);
}

Tracker::~Tracker() = default;
Tracker::Tracker(const Tracker& other)
    : session_(std::make_unique<TrackingSession>(*other.session_)) {}
Tracker& Tracker::operator=(const Tracker& other) { return *this = Tracker(other); }
Tracker::Tracker(Tracker&&) noexcept = default;
Tracker& Tracker::operator=(Tracker&&) noexcept = default;

void Tracker::initialize(const Eigen::Isometry3d& T_map_lidar,
                         const Eigen::Matrix<double, 6, 6>& covariance) {
  require_rigid("initial pose", T_map_lidar, kMaxCoordinateM);
  require_covariance("initial pose", covariance);
  session_->initialize({T_map_lidar, covariance});
}

TrackedPose Tracker::track(std::int64_t stamp_ns, const maps::PointCloud& scan_lidar,
                           const std::optional<OdometryStep>& odometry) {
  require_usable(scan_lidar);
  ThinScan thinned = thin(view_of(scan_lidar));
  thinned.points_lidar.turn = scan_lidar.turn;
  return track_thin(stamp_ns, thinned, odometry);
}

ThinScan Tracker::thin(const ScanView& scan_lidar) const {
  return session_->aligner().thin(scan_lidar);
}

std::optional<std::int64_t> Tracker::newest_ns() const { return session_->newest_ns(); }

std::string Tracker::state() const {
  if (!session_->newest_ns())
    throw std::logic_error("tracker: no scan was answered yet; give it one before its state");
  return encode_state(session_->state());
}

Tracker Tracker::restored(std::shared_ptr<const Aligner> aligner, const TrackerOptions& options,
                          std::string_view state) {
  Tracker tracker(std::move(aligner), options);
  tracker.session_->restore(decode_state(state));
  return tracker;
}

std::optional<Eigen::Isometry3d> Tracker::believed_T_map_lidar() const {
  return session_->believed_T_map_lidar();
}

bool Tracker::knows_place_at(std::int64_t stamp_ns,
                             const std::optional<OdometryStep>& odometry) const {
  return session_->knows_place_at(stamp_ns, odometry);
}

void Tracker::forget_place() { session_->forget_place(); }

Tracker Tracker::continued_in(std::shared_ptr<const Aligner> aligner, const TrackerOptions& options,
                              const Eigen::Isometry3d& T_other_map,
                              const Eigen::Matrix<double, 6, 6>& covariance) const {
  require_rigid("frame of the other map", T_other_map, kMaxCoordinateM);
  require_covariance("frame of the other map", covariance);
  Tracker other(std::move(aligner), options);
  other.session_->continue_from(*session_, T_other_map, covariance);
  return other;
}

TrackedPose Tracker::track_thin(std::int64_t stamp_ns, const ThinScan& scan_lidar,
                                const std::optional<OdometryStep>& odometry) {
  require_usable(scan_lidar.points_lidar);
  if (odometry) {
    require_rigid("odometry", odometry->T_since_lidar, kMaxMotionM);
    require_covariance("odometry", odometry->covariance);
    if (odometry->since_ns >= stamp_ns) {
      throw std::invalid_argument(fmt::format(
          "odometry: since {} ns, expected before the scan's {}", odometry->since_ns, stamp_ns));
    }
  }
  return session_->track(stamp_ns, scan_lidar, odometry);
}

}  // namespace stillmap::localization
