#include "vehicle_localizer.hpp"

#include <stillmap/maps/ros_cloud.hpp>

#include <cmath>
#include <cstdio>
#include <span>
#include <stdexcept>

#include "map_around.hpp"
#include "odometry_track.hpp"

namespace stillmap::vehicle {
namespace {

Eigen::Isometry3d motion_of(const client::Pose& pose) {
  const auto& [x, y, z, w] = pose.quaternion;
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = Eigen::Quaterniond(w, x, y, z).normalized().toRotationMatrix();
  T.translation() = Eigen::Vector3d(pose.position.data());
  return T;
}

client::Pose pose_of(const Eigen::Isometry3d& T) {
  const Eigen::Quaterniond q(T.linear());
  return {{T.translation().x(), T.translation().y(), T.translation().z()},
          {q.x(), q.y(), q.z(), q.w()}};
}

/// Takes a perturbation on the right in frame b to one in frame a: exp(Ad x) T = T exp(x), order
/// translation, rotation (Barfoot, State Estimation for Robotics, 7.1.4).
Matrix6d adjoint(const Eigen::Isometry3d& T_a_b) {
  const Eigen::Matrix3d R = T_a_b.linear();
  const Eigen::Vector3d t = T_a_b.translation();
  Eigen::Matrix3d cross;
  cross << 0, -t.z(), t.y(), t.z(), 0, -t.x(), -t.y(), t.x(), 0;
  Matrix6d ad = Matrix6d::Zero();
  ad.topLeftCorner<3, 3>() = R;
  ad.topRightCorner<3, 3>() = cross * R;
  ad.bottomRightCorner<3, 3>() = R;
  return ad;
}

/// Turns both halves of a perturbation.
Matrix6d turn(const Eigen::Matrix3d& R) {
  Matrix6d both = Matrix6d::Zero();
  both.topLeftCorner<3, 3>() = R;
  both.bottomRightCorner<3, 3>() = R;
  return both;
}

std::string text_of(double value, const char* unit) {
  char text[64];
  std::snprintf(text, sizeof text, "%.3f %s", value, unit);
  return text;
}

std::string bound_of(const std::optional<double>& value, const char* unit) {
  return value ? text_of(*value, unit) : "none";
}

std::string joined(const std::vector<std::string>& words) {
  std::string all;
  for (const std::string& word : words) all += (all.empty() ? "" : ", ") + word;
  return all;
}

}  // namespace

std::optional<localization::ThinProfile> thin_profile_of(const std::string& name) {
  if (name == "exact") return localization::ThinProfile::kExact;
  if (name == "compact") return localization::ThinProfile::kCompact;
  if (name == "none") return std::nullopt;
  throw std::invalid_argument("thin: found '" + name + "', expected exact, compact or none");
}

client::Prior prior_of(const Eigen::Isometry3d& T_map_base, const Matrix6d& covariance_map,
                       const Eigen::Isometry3d& T_base_lidar) {
  constexpr double kUntoldM = 2.0;
  constexpr double kUntoldRad = 0.13;
  Matrix6d told = covariance_map;
  for (int i = 0; i < 6; ++i) {
    if (!told.row(i).isZero(0.0) || !told.col(i).isZero(0.0)) continue;
    told(i, i) = std::pow(i < 3 ? kUntoldM : kUntoldRad, 2);
  }
  const Matrix6d to_lidar = adjoint(T_base_lidar.inverse()) * turn(T_map_base.linear().transpose());
  const Matrix6d covariance = to_lidar * told * to_lidar.transpose();
  client::Prior prior{pose_of(T_map_base * T_base_lidar)};
  prior.covariance.emplace();
  Eigen::Map<Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(prior.covariance->data()) =
      0.5 * (covariance + covariance.transpose());
  return prior;
}

Estimate estimate_of(std::int64_t stamp_ns, const client::PoseAnswer& answer,
                     const Eigen::Isometry3d& T_base_lidar) {
  Estimate estimate;
  estimate.stamp_ns = stamp_ns;
  estimate.T_map_base = motion_of(answer.pose.value()) * T_base_lidar.inverse();
  const Matrix6d covariance =
      Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(answer.covariance->data());
  const Matrix6d to_map = turn(estimate.T_map_base.linear()) * adjoint(T_base_lidar);
  estimate.covariance = to_map * covariance * to_map.transpose();
  estimate.degraded = answer.status != "ok";
  return estimate;
}

class VehicleLocalizer::Work {
 public:
  Work(Settings settings, Callbacks callbacks)
      : settings_(std::move(settings)), callbacks_(std::move(callbacks)) {
    if (settings_.map.empty()) throw std::invalid_argument("map: found nothing, expected its name");
    client::Client sender(settings_.url, settings_.key);
    sender.thin_scans(settings_.thin, settings_.own_vehicle_m);
    client::SessionOptions session;
    session.version = settings_.version;
    session.label = settings_.label;
    client::ScanOptions scans;
    scans.deadline = settings_.deadline;
    const auto on_answer = [this](std::int64_t stamp_ns, const client::PoseAnswer& answer) {
      take_answer(stamp_ns, answer);
    };
    const auto on_error = [this](std::int64_t, const client::Error& error) {
      const std::lock_guard lock(mutex_);
      error_ = error.what();
    };
    stream_ = std::make_unique<client::SessionStream>(std::move(sender), settings_.map, on_answer,
                                                      on_error, session, scans);
    around_ = std::make_unique<MapAround>(settings_, callbacks_.on_map_points);
  }
  Work(const Work&) = delete;
  Work& operator=(const Work&) = delete;
  ~Work() {
    // Each uses the other: none may go while the other's thread runs.
    stream_->stop();
    around_.reset();
  }

  void take_scan(const std::string& type, maps::RosVersion ros, std::span<const std::byte> message,
                 const std::string& topic) {
    client::SessionStream::Scan scan;
    try {
      const maps::RosCloud cloud = maps::decode_ros_cloud(type, ros, message, topic);
      const bool has_mount = find_mount(cloud.frame_id);
      const std::lock_guard lock(mutex_);
      scan_time_ = Clock::now();
      bad_scan_.clear();
      if (!has_mount) return;
      scan.stamp_ns = cloud.stamp_ns;
      scan.odometry = step_to(cloud.stamp_ns);
      fill(scan, cloud.scan.cloud);
    } catch (const std::exception& error) {
      const std::lock_guard lock(mutex_);
      ++bad_scans_;
      bad_scan_ = error.what();
      return;
    }
    stream_->put(std::move(scan));
  }

  void take_odometry(std::int64_t stamp_ns, const Eigen::Isometry3d& T_odom_base) {
    const std::lock_guard lock(mutex_);
    odometry_.add(stamp_ns, T_odom_base);
  }

  bool initialize(const Eigen::Isometry3d& T_map_base, const Matrix6d& covariance_map) {
    std::optional<Eigen::Isometry3d> T_base_lidar;
    {
      const std::lock_guard lock(mutex_);
      T_base_lidar = T_base_lidar_;
    }
    if (!T_base_lidar) return false;
    const auto start = [this, covariance_map, T_base_lidar](const Eigen::Isometry3d& T) {
      stream_->initialize(prior_of(T, covariance_map, *T_base_lidar));
    };
    if (!covariance_map.row(2).isZero(0.0)) {
      start(T_map_base);
      return true;
    }
    around_->find_ground(T_map_base.translation().head<2>(),
                         [start, T_map_base](std::optional<double> z) {
                           Eigen::Isometry3d T = T_map_base;
                           T.translation().z() = z.value_or(T.translation().z());
                           start(T);
                         });
    return true;
  }

  [[nodiscard]] std::optional<Eigen::Isometry3d> T_map_odom() const {
    const std::lock_guard lock(mutex_);
    if (is_old(pose_time_)) return std::nullopt;
    return T_map_odom_;
  }

  [[nodiscard]] Health health() const {
    const client::SessionStream::Counts counts = stream_->counts();
    const std::string tiles = around_->error();
    const std::lock_guard lock(mutex_);
    Health health = judged();
    auto& values = health.values;
    values = {{"server", settings_.url}, {"map", settings_.map}};
    if (answer_) tell_answer(values);
    values.insert(values.end(), {{"scans answered", std::to_string(counts.answered)},
                                 {"scans replaced by newer", std::to_string(counts.superseded)},
                                 {"scans without answer", std::to_string(counts.failed)},
                                 {"scans not readable", std::to_string(bad_scans_)},
                                 {"sessions", std::to_string(counts.sessions)},
                                 {"odometry", odometry_.empty() ? "none" : "received"}});
    if (!error_.empty()) values.emplace_back("last error", error_);
    if (!tiles.empty()) values.emplace_back("map tiles", tiles);
    return health;
  }

 private:
  using Clock = std::chrono::steady_clock;
  using Values = std::vector<std::pair<std::string, std::string>>;

  bool find_mount(const std::string& lidar_frame) {
    {
      const std::lock_guard lock(mutex_);
      if (T_base_lidar_) return true;
    }
    const auto mount = callbacks_.find_mount(lidar_frame);
    const std::lock_guard lock(mutex_);
    lidar_frame_ = lidar_frame;
    T_base_lidar_ = mount;
    return mount.has_value();
  }

  static void fill(client::SessionStream::Scan& scan, const maps::PointCloud& cloud) {
    const bool has_times = !cloud.empty() && cloud.time_offsets_s.size() == cloud.size();
    const bool has_intensities = cloud.intensities.size() == cloud.size();
    scan.layout = has_times ? "xyzit" : "xyzi";
    scan.points.reserve(scan.layout.size() * cloud.size());
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      const Eigen::Vector3f& p = cloud.positions[i];
      const float intensity = has_intensities ? cloud.intensities[i] : 0.0F;
      scan.points.insert(scan.points.end(), {p.x(), p.y(), p.z(), intensity});
      if (has_times) scan.points.push_back(cloud.time_offsets_s[i]);
    }
  }

  /// From the newest scan whose place is known, since the server keeps that place.
  [[nodiscard]] std::optional<client::Odometry> step_to(std::int64_t stamp_ns) const {
    if (!known_at_ns_ || *known_at_ns_ >= stamp_ns) return std::nullopt;
    const auto before = odometry_.at(*known_at_ns_);
    const auto now = odometry_.at(stamp_ns);
    if (!before || !now) return std::nullopt;
    client::Odometry step;
    step.since_ns = *known_at_ns_;
    step.pose = pose_of(T_base_lidar_->inverse() * before->inverse() * *now * *T_base_lidar_);
    step.sigma_m = settings_.odometry_sigma_m;
    step.sigma_rad = settings_.odometry_sigma_rad;
    return step;
  }

  void take_answer(std::int64_t stamp_ns, const client::PoseAnswer& answer) {
    std::optional<Estimate> estimate;
    {
      const std::lock_guard lock(mutex_);
      answer_ = answer;
      answer_->json.clear();
      answer_time_ = Clock::now();
      error_.clear();
      if (answer.pose && answer.covariance) {
        estimate = estimate_of(stamp_ns, answer, *T_base_lidar_);
        pose_time_ = answer_time_;
        known_at_ns_ = stamp_ns;
        if (const auto T_odom_base = odometry_.at(stamp_ns))
          T_map_odom_ = estimate->T_map_base * T_odom_base->inverse();
      }
    }
    if (!estimate) return;
    callbacks_.on_estimate(*estimate);
    around_->move_to(estimate->T_map_base.translation().head<2>());
  }

  [[nodiscard]] bool is_old(const std::optional<Clock::time_point>& time) const {
    return !time || Clock::now() - *time > settings_.patience;
  }

  /// The first thing that is wrong, and what to do about it behind the colon.
  [[nodiscard]] Health judged() const {
    if (!bad_scan_.empty()) return {HealthLevel::kError, bad_scan_, {}};
    if (is_old(scan_time_))
      return {HealthLevel::kError, "no scans: look at the lidar's driver", {}};
    if (!T_base_lidar_)
      return {HealthLevel::kError, "no transform to " + lidar_frame_ + ": publish it", {}};
    if (!error_.empty()) {
      const HealthLevel level = is_old(answer_time_) ? HealthLevel::kError : HealthLevel::kWarn;
      return {level, "no pose from " + settings_.url + ": " + error_, {}};
    }
    if (is_old(answer_time_))
      return {HealthLevel::kError, "no answer from " + settings_.url + ": look at the server", {}};
    const std::string reasons = answer_->reasons.empty() ? "" : ": " + joined(answer_->reasons);
    if (answer_->status == "lost") return {HealthLevel::kError, "lost" + reasons, {}};
    if (answer_->status != "ok") return {HealthLevel::kWarn, answer_->status + reasons, {}};
    if (odometry_.empty())
      return {HealthLevel::kWarn, "ok, but no odometry: there is no transform to its frame", {}};
    return {HealthLevel::kOk, "ok", {}};
  }

  void tell_answer(Values& values) const {
    const client::Protection& bounds = answer_->protection;
    values.insert(values.end(), {{"version", answer_->map.version},
                                 {"session", answer_->session},
                                 {"status", answer_->status},
                                 {"reasons", joined(answer_->reasons)},
                                 {"searched from", answer_->searched_from},
                                 {"inlier ratio", text_of(answer_->inlier_ratio, "")},
                                 {"protection longitudinal", bound_of(bounds.longitudinal_m, "m")},
                                 {"protection lateral", bound_of(bounds.lateral_m, "m")},
                                 {"protection vertical", bound_of(bounds.vertical_m, "m")},
                                 {"protection yaw", bound_of(bounds.yaw_rad, "rad")},
                                 {"time in the server", text_of(answer_->timing.total_ms, "ms")}});
  }

  Settings settings_;
  Callbacks callbacks_;
  mutable std::mutex mutex_;
  std::optional<Eigen::Isometry3d> T_base_lidar_;
  std::string lidar_frame_;
  OdometryTrack odometry_;
  /// Of the newest scan whose place is known.
  std::optional<std::int64_t> known_at_ns_;
  std::optional<Eigen::Isometry3d> T_map_odom_;
  std::optional<client::PoseAnswer> answer_;
  /// Of the last scan without an answer; empty after an answer.
  std::string error_;
  std::string bad_scan_;
  std::uint64_t bad_scans_ = 0;
  std::optional<Clock::time_point> scan_time_;
  std::optional<Clock::time_point> answer_time_;
  std::optional<Clock::time_point> pose_time_;
  // Last, since their threads use all of the above.
  std::unique_ptr<client::SessionStream> stream_;
  std::unique_ptr<MapAround> around_;
};

VehicleLocalizer::VehicleLocalizer(Settings settings, Callbacks callbacks)
    : work_(std::make_unique<Work>(std::move(settings), std::move(callbacks))) {}
VehicleLocalizer::~VehicleLocalizer() = default;

void VehicleLocalizer::take_ros1_scan(const std::string& type, const std::uint8_t* bytes,
                                      std::size_t size, const std::string& topic) {
  work_->take_scan(type, maps::RosVersion::kRos1, std::as_bytes(std::span(bytes, size)), topic);
}

void VehicleLocalizer::take_ros2_scan(const std::string& type, const std::uint8_t* bytes,
                                      std::size_t size, const std::string& topic) {
  work_->take_scan(type, maps::RosVersion::kRos2, std::as_bytes(std::span(bytes, size)), topic);
}

void VehicleLocalizer::take_odometry(std::int64_t stamp_ns, const Eigen::Isometry3d& T_odom_base) {
  work_->take_odometry(stamp_ns, T_odom_base);
}

bool VehicleLocalizer::initialize(const Eigen::Isometry3d& T_map_base,
                                  const Matrix6d& covariance_map) {
  return work_->initialize(T_map_base, covariance_map);
}

std::optional<Eigen::Isometry3d> VehicleLocalizer::T_map_odom() const {
  return work_->T_map_odom();
}

Health VehicleLocalizer::health() const { return work_->health(); }

}  // namespace stillmap::vehicle
