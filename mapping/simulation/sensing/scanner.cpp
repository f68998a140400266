#include "sensing/scanner.hpp"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>

#include "geometry/random.hpp"
#include "sensing/echo.hpp"

namespace stillmap::simulation {
namespace {

/// The sensor's pose during a sweep, between exact ones at short steps.
class SweepPoses {
 public:
  SweepPoses(const EgoMotion& ego, double stamp_s, double period_s)
      : begin_s_(-0.5 * period_s), step_s_(period_s / kSteps) {
    for (int i = 0; i <= kSteps; ++i) {
      const Eigen::Isometry3d T = ego.T_world_lidar(stamp_s + begin_s_ + step_s_ * i);
      positions_.emplace_back(T.translation());
      rotations_.emplace_back(T.linear());
      // Of the two quaternions of a rotation, the one near the last.
      if (i > 0 && rotations_.back().dot(rotations_[rotations_.size() - 2]) < 0.0) {
        rotations_.back().coeffs() *= -1.0;
      }
    }
  }

  [[nodiscard]] Ray ray(const Beam& beam) const {
    const double at = (static_cast<double>(beam.time_s) - begin_s_) / step_s_;
    const auto i = static_cast<std::size_t>(std::clamp(at, 0.0, kSteps - 1.0));
    const double t = at - static_cast<double>(i);
    const Eigen::Vector3d origin = positions_[i] + t * (positions_[i + 1] - positions_[i]);
    Eigen::Quaterniond q = rotations_[i];
    q.coeffs() += t * (rotations_[i + 1].coeffs() - rotations_[i].coeffs());
    Ray ray;
    q.normalize();
    ray.origin = (origin + q * beam.origin.cast<double>()).cast<float>();
    ray.direction = (q * beam.direction.cast<double>()).cast<float>();
    ray.share = static_cast<float>(std::clamp(at / kSteps, 0.0, 1.0));
    return ray;
  }

 private:
  static constexpr int kSteps = 50;
  double begin_s_;
  double step_s_;
  std::vector<Eigen::Vector3d> positions_;
  std::vector<Eigen::Quaterniond> rotations_;
};

/// Echoes of a sweep, one a beam.
struct Echoes {
  std::vector<std::optional<Echo>> seen;
  std::vector<std::optional<Echo>> behind;
};

void append(LabelledPoints& points, const Beam& beam, const Echo& echo,
            const SensorProperties& sensor) {
  double range = echo.range_m;
  if (sensor.range_step_m > 0.0) {
    range = std::round(range / sensor.range_step_m) * sensor.range_step_m;
  }
  if (range < sensor.min_range_m || range > sensor.max_range_m) return;
  points.positions.emplace_back(beam.origin + static_cast<float>(range) * beam.direction);
  // Hundredths, as KITTI stores them.
  points.intensities.push_back(
      static_cast<float>(std::round(100.0 * std::clamp(echo.intensity, 0.0, 0.99)) / 100.0));
  points.labels.push_back(echo.label);
  points.time_offsets_s.push_back(beam.time_s);
  points.rings.push_back(beam.ring);
}

/// The smallest box upright in the lidar frame, along the object's heading, that holds its shape.
maps::Box box_of(const Mesh& mesh, const Eigen::Isometry3d& T_lidar_body) {
  const Eigen::Vector3d heading = T_lidar_body.linear().col(0);
  const double yaw = std::atan2(heading.y(), heading.x());
  const Eigen::Matrix3d R_box_lidar =
      Eigen::AngleAxisd(-yaw, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  const Eigen::Isometry3f T = (R_box_lidar * T_lidar_body).cast<float>();
  Eigen::AlignedBox3f bounds;
  for (const Eigen::Vector3f& corner : mesh.vertices) bounds.extend(T * corner);
  maps::Box box;
  box.centre = R_box_lidar.transpose() * bounds.center().cast<double>();
  box.size_m = bounds.sizes().cast<double>();
  box.yaw_rad = yaw;
  return box;
}

struct Seen {
  double time_sum_s = 0.0;
  std::size_t points = 0;
};

void add_boxes(SimulatedScan& scan, const World& world, const EgoMotion& ego) {
  std::map<std::size_t, Seen> seen;
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    const std::uint32_t instance = scan.points.labels[i] >> kInstanceShift;
    if (instance == 0) continue;
    Seen& s = seen[instance - 1];
    s.time_sum_s += static_cast<double>(scan.points.time_offsets_s[i]);
    ++s.points;
  }
  for (const auto& [index, s] : seen) {
    const Actor& actor = world.actors[index];
    const double time_s = scan.stamp_s + s.time_sum_s / static_cast<double>(s.points);
    const Mesh& mesh = world.bodies[actor.body].postures[posture_of(world, actor, scan.stamp_s)];
    const Eigen::Isometry3d T_world_body = T_world_actor(world, actor, time_s);
    for (const auto& [boxes, at_s] :
         {std::pair{&scan.boxes, time_s}, std::pair{&scan.boxes_at_stamp, scan.stamp_s}}) {
      maps::Box box = box_of(mesh, ego.T_world_lidar(at_s).inverse() * T_world_body);
      box.object_class = actor.object_class;
      box.track = static_cast<int>(index) + 1;
      boxes->push_back(box);
    }
  }
}

/// Lasers of one unit differ in what they report of the same surface; a few are far off.
constexpr double kRingGain = 0.06;
constexpr double kDullShare = 0.12;
constexpr double kDullGain = 0.6;

/// Label of SemanticKITTI for what is none of its classes.
constexpr std::uint32_t kOwnVehicle = 1;

}  // namespace

Scanner::Scanner(const World& world, const EgoMotion& ego, Sensor& sensor,
                 const ScannerOptions& options)
    : world_(world),
      ego_(ego),
      sensor_(sensor),
      key_(options.key),
      behind_(options.behind),
      phase_s_(options.phase_s),
      scene_(world),
      own_vehicle_(world.own_body.postures.front()) {
  const SensorProperties& properties = sensor.properties();
  for (std::size_t ring = 0; ring < std::max<std::size_t>(properties.rings, 1); ++ring) {
    const auto stream = static_cast<std::uint64_t>(Stream::kRays);
    Random random(options.unit == 0 ? key_of({stream, ring})
                                    : key_of({stream, ring, options.unit}));
    ring_bias_m_.push_back(properties.ring_bias_m * random.normal());
    const bool dull = random.chance(kDullShare);
    ring_gain_.push_back((dull ? kDullGain : 1.0) *
                         std::max(0.5, 1.0 + kRingGain * random.normal()));
  }
}

void Scanner::look_at_own_vehicle(const std::vector<Beam>& beams) {
  // A spinning sensor's beams are the same in every sweep.
  if (sensor_.properties().rings > 0 && own_range_m_.size() == beams.size()) return;
  own_range_m_.clear();
  Ray ray;
  // Behind the middle, as sensors are mounted over the rear seats.
  const Eigen::Vector3f usual(-0.3F, 0.0F, static_cast<float>(sensor_.properties().height_m));
  const Eigen::Isometry3f T_usual_lidar = ego_.T_usual_lidar().cast<float>();
  ray.max_range_m = 10.0F;
  for (const Beam& beam : beams) {
    ray.origin = usual + T_usual_lidar * beam.origin;
    ray.direction = T_usual_lidar.linear() * beam.direction;
    // Nothing is around a sensor in the hand.
    const std::optional<Hit> hit =
        ego_.carrier() == Carrier::kHand ? std::nullopt : own_vehicle_.cast(ray);
    own_range_m_.push_back(hit ? static_cast<float>(hit->range_m)
                               : std::numeric_limits<float>::infinity());
  }
}

SimulatedScan Scanner::take(std::size_t index) {
  const SensorProperties& properties = sensor_.properties();
  const std::vector<Beam>& beams = sensor_.beams(index);
  SimulatedScan scan;
  scan.stamp_s = properties.period_s * static_cast<double>(index) + phase_s_;
  const double half = 0.5 * properties.period_s;
  const SweepPoses poses(ego_, scan.stamp_s, properties.period_s);
  scene_.place_actors(scan.stamp_s - half, scan.stamp_s + half,
                      ego_.T_world_lidar(scan.stamp_s).translation(), properties.max_range_m);
  look_at_own_vehicle(beams);
  const std::uint64_t key = key_of({key_, index});
  Echoes echoes{std::vector<std::optional<Echo>>(beams.size()),
                std::vector<std::optional<Echo>>(beams.size())};
  constexpr std::size_t kPacket = RayScene::kPacket;
  const std::size_t packets = (beams.size() + kPacket - 1) / kPacket;
  const auto cast_packet = [&](std::size_t first, std::size_t count) {
    std::array<Ray, kPacket> rays;
    std::array<Hits, kPacket> hits;
    for (std::size_t i = 0; i < count; ++i) {
      rays[i] = poses.ray(beams[first + i]);
      rays[i].max_range_m = static_cast<float>(properties.max_range_m);
    }
    scene_.cast(rays.data(), count, hits.data());
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t ray = first + i;
      if (const float own = own_range_m_[ray]; std::isfinite(own)) {
        if (static_cast<double>(own) > properties.min_range_m) {
          echoes.seen[ray] = Echo{static_cast<double>(own), 0.2, 1.0, kOwnVehicle};
        }
        continue;
      }
      const std::size_t ring = properties.rings > 0 ? beams[ray].ring : 0;
      const auto as_measured = [&](std::optional<Echo> echo) {
        if (!echo) return echo;
        echo->range_m += ring_bias_m_[ring];
        echo->intensity *= ring_gain_[ring];
        return echo;
      };
      RayOutcome outcome = follow_ray(world_, scene_, properties, rays[i], hits[i], true,
                                      Random(key_of({key, 2, ray})));
      echoes.seen[ray] = as_measured(outcome.echo);
      if (!behind_ || !outcome.met_object) continue;
      outcome = follow_ray(world_, scene_, properties, rays[i], hits[i], false,
                           Random(key_of({key, 3, ray})));
      echoes.behind[ray] = as_measured(outcome.echo);
    }
  };
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, packets, 64), [&](const auto& range) {
    for (std::size_t p = range.begin(); p < range.end(); ++p) {
      cast_packet(p * kPacket, std::min(kPacket, beams.size() - p * kPacket));
    }
  });
  mix_edges(echoes.seen, beams, properties, key);
  for (std::size_t i = 0; i < beams.size(); ++i) {
    if (echoes.seen[i]) append(scan.points, beams[i], *echoes.seen[i], properties);
    if (echoes.behind[i]) append(scan.behind, beams[i], *echoes.behind[i], properties);
  }
  add_boxes(scan, world_, ego_);
  rays_ += beams.size();
  return scan;
}

}  // namespace stillmap::simulation
