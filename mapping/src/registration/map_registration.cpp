#include "registration/map_registration.hpp"

#include "core/ordered_pipeline.hpp"
#include "drives/drive_set.hpp"
#include "registration/frame_fit.hpp"
#include "registration/map_following.hpp"

#include <fmt/format.h>
#include <stillmap/localization/aligner.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/geodesy.hpp>

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <utility>

namespace stillmap::mapping {
namespace {

constexpr double kRadPerDeg = 0.017453292519943295;
constexpr std::size_t kScansToFind = 48;
constexpr std::size_t kScansToMeasure = 96;
/// Odometry of the whole drive lies between the places of any two scans.
constexpr FrameTolerance kFound{.translation_m = 3.0, .rotation_rad = 3.0 * kRadPerDeg};
constexpr std::size_t kLeastFound = 3;
/// Beyond, a vehicle would notice that the map has moved.
constexpr FrameTolerance kAgreed{.translation_m = 0.3, .rotation_rad = 1.0 * kRadPerDeg};
constexpr std::size_t kLeastAgreeing = 8;
constexpr double kLeastShareAgreeing = 0.75;
/// Scans from one place share their errors.
constexpr double kLeastApartM = 1.0;
constexpr double kLeastSpanM = 10.0;
/// A scan is found this far from where the map was driven.
constexpr double kFromPlaceM = 15.0;
/// What given poses may be moved by without being moved: what localization itself is wrong by.
constexpr FrameTolerance kKept{.translation_m = 0.05, .rotation_rad = 0.1 * kRadPerDeg};

/// So many of them, spread evenly from the first to the last.
std::vector<std::size_t> spread(const std::vector<std::size_t>& all, std::size_t count) {
  if (all.size() <= count) return all;
  std::vector<std::size_t> some;
  for (std::size_t i = 0; i < count; ++i) some.push_back(all[i * (all.size() - 1) / (count - 1)]);
  return some;
}

/// Whether the poses say where they are in the map's frame, and by which motion.
std::optional<Eigen::Isometry3d> claimed(const maps::MapManifest& map, const maps::Drive& first,
                                         const std::string& odometry) {
  const auto& own = first.contents().origin;
  if (own && map.geodetic_origin) return maps::T_enu_enu(*map.geodetic_origin, *own);
  // Odometry without geodesy starts at an origin of its own.
  if (own || map.geodetic_origin || odometry != "given") return std::nullopt;
  return Eigen::Isometry3d::Identity();
}

class FrameSearch {
 public:
  FrameSearch(std::shared_ptr<const maps::MapPackage> map, const DriveSet& drives, int threads,
              const ProgressCallback& progress, const CancelFlag& cancel)
      : map_(std::move(map)),
        aligner_(localization::make_aligner("default", *map_)),
        seen_from_(localization::seen_from(*map_)),
        drives_(drives),
        threads_(threads),
        progress_(progress),
        cancel_(cancel) {}

  /// Those of the scans that are found for sure. @param T_map_own  none: looked for everywhere.
  [[nodiscard]] std::vector<FrameSight> localize(
      const std::vector<std::size_t>& scans,
      const std::optional<Eigen::Isometry3d>& T_map_own) const {
    std::vector<FrameSight> sights;
    std::size_t done = 0;
    process_in_order(
        scans.size(), threads_, [&](std::size_t i) { return sight_of(scans[i], T_map_own); },
        [&](std::optional<FrameSight>&& sight) {
          if (sight) sights.push_back(*sight);
          if (progress_) progress_("register", ++done, scans.size());
        },
        cancel_);
    return sights;
  }

  [[nodiscard]] std::vector<std::size_t> to_find() const {
    std::vector<std::size_t> all;
    for (std::size_t i = 0; i < drives_.size(); ++i)
      if (drives_.note(i) != ScanNote::kHidden) all.push_back(i);
    return spread(all, kScansToFind);
  }

  /// Scans that stand where the map was driven, when the frames differ by this; all of them, or
  /// some.
  [[nodiscard]] std::vector<std::size_t> to_measure(const Eigen::Isometry3d& T_map_own,
                                                    bool all) const {
    std::vector<std::size_t> near;
    std::optional<Eigen::Vector3d> last;
    for (std::size_t scan = 0; scan < drives_.size(); ++scan) {
      if (drives_.note(scan) == ScanNote::kHidden) continue;
      const Eigen::Vector3d p_map = T_map_own * drives_.T_map_scan(scan).translation();
      if (last && (p_map - *last).norm() < kLeastApartM) continue;
      if (!is_near(p_map)) continue;
      last = p_map;
      near.push_back(scan);
    }
    return all ? near : spread(near, kScansToMeasure);
  }

 private:
  [[nodiscard]] std::optional<FrameSight> sight_of(
      std::size_t scan, const std::optional<Eigen::Isometry3d>& T_map_own) const {
    std::map<std::string, std::uint64_t> counts;
    const maps::Scan read = drives_.read(scan, counts);
    const Eigen::Isometry3d& T_own_scan = drives_.T_map_scan(scan);
    std::optional<localization::Prior> prior;
    if (T_map_own) prior.emplace().T_map_lidar = maps::renormalized(*T_map_own * T_own_scan);
    const localization::AlignmentResult found = aligner_->align(read.cloud, prior);
    if (found.status != localization::PoseStatus::kOk) return std::nullopt;
    return FrameSight{T_own_scan, found.T_map_lidar, found.covariance, scan};
  }

  [[nodiscard]] bool is_near(const Eigen::Vector3d& p_map) const {
    return seen_from_.empty() ||
           std::any_of(seen_from_.begin(), seen_from_.end(), [&](const Eigen::Isometry3d& T) {
             return (T.translation() - p_map).head<2>().norm() <= kFromPlaceM;
           });
  }

  std::shared_ptr<const maps::MapPackage> map_;
  std::unique_ptr<localization::Aligner> aligner_;
  std::vector<Eigen::Isometry3d> seen_from_;
  const DriveSet& drives_;
  int threads_;
  const ProgressCallback& progress_;
  const CancelFlag& cancel_;
};

[[noreturn]] void refuse(const std::filesystem::path& map, const std::string& found,
                         const std::string& expected) {
  throw maps::InputError(map.string(), found, expected);
}

Eigen::Isometry3d find(const std::filesystem::path& map, const FrameSearch& search,
                       const std::optional<Eigen::Isometry3d>& claim) {
  const std::vector<std::size_t> scans = search.to_find();
  if (claim) {
    if (const auto T = most_agreed(search.localize(scans, claim), kFound, kLeastFound)) return *T;
  }
  const std::vector<FrameSight> sights = search.localize(scans, std::nullopt);
  if (const auto T = most_agreed(sights, kFound, kLeastFound)) return *T;
  if (sights.size() < kLeastFound)
    refuse(
        map,
        fmt::format("only {} of {} scans of the drives in this map", sights.size(), scans.size()),
        fmt::format("at least {}: the drives do not overlap with this map, or the place has "
                    "changed; give a map of the same place, or build without --register-to",
                    kLeastFound));
  refuse(map, fmt::format("{} scans at places of this map that do not fit together", sights.size()),
         fmt::format("more than half of them within {} m of one motion: give a map of the same "
                     "place, or build without --register-to",
                     kFound.translation_m));
}

/// Largest distance from the first sight that agrees [m].
double span_of(const std::vector<FrameSight>& sights, const FrameFit& fit) {
  const FrameSight* first = nullptr;
  double span_m = 0.0;
  for (std::size_t i = 0; i < sights.size(); ++i) {
    if (fit.agrees[i] == 0) continue;
    if (first == nullptr) first = &sights[i];
    const Eigen::Vector3d way =
        sights[i].T_map_lidar.translation() - first->T_map_lidar.translation();
    span_m = std::max(span_m, way.norm());
  }
  return span_m;
}

void require_agreement(const std::filesystem::path& map, const std::vector<FrameSight>& sights,
                       const FrameFit& fit, std::size_t asked) {
  if (static_cast<double>(fit.agreeing) < kLeastShareAgreeing * static_cast<double>(sights.size()))
    refuse(
        map,
        fmt::format("{} of {} scans that agree on one motion of the drives into this map (within "
                    "{} m and {:g} deg)",
                    fit.agreeing, sights.size(), kAgreed.translation_m,
                    kAgreed.rotation_rad / kRadPerDeg),
        fmt::format("at least {} %: the poses of the drives, or of this map, are bent; check the "
                    "drives (`stillmap inspect DRIVE --motion`), or build without --register-to",
                    100 * kLeastShareAgreeing));
  const double span_m = span_of(sights, fit);
  if (fit.agreeing < kLeastAgreeing || !(span_m >= kLeastSpanM))
    refuse(map,
           fmt::format("{} of {} scans of the drives in this map, over {:.1f} m", fit.agreeing,
                       asked, span_m),
           fmt::format("at least {} over {} m: too little of the drives overlaps with this map; "
                       "give longer drives, or build without --register-to",
                       kLeastAgreeing, kLeastSpanM));
}

/// Whether a motion leaves all poses where they are, as far as localization can tell.
bool leaves_in_place(const Eigen::Isometry3d& T, const DriveSet& drives,
                     const Eigen::Isometry3d& T_map_own) {
  if (!(maps::rotation_angle_rad(T.linear()) <= kKept.rotation_rad)) return false;
  for (std::size_t scan = 0; scan < drives.size(); ++scan) {
    const Eigen::Vector3d p = T_map_own * drives.T_map_scan(scan).translation();
    if (!((T * p - p).norm() <= kKept.translation_m)) return false;
  }
  return true;
}

std::vector<maps::Drive> moved(const std::vector<maps::Drive>& drives, const Eigen::Isometry3d& T,
                               const std::optional<maps::GeodeticOrigin>& origin) {
  const bool stay = T.matrix().isIdentity(0.0);
  std::vector<maps::Drive> moved;
  for (const maps::Drive& drive : drives) {
    std::vector<Eigen::Isometry3d> poses = drive.contents().T_map_lidar;
    if (!stay) {
      for (Eigen::Isometry3d& pose : poses) pose = maps::renormalized(T * pose);
    }
    moved.push_back(drive.with_poses(std::move(poses), origin));
  }
  return moved;
}

std::vector<FrameSight> agreeing(const std::vector<FrameSight>& sights, const FrameFit& fit) {
  std::vector<FrameSight> agreeing;
  for (std::size_t i = 0; i < sights.size(); ++i)
    if (fit.agrees[i] != 0) agreeing.push_back(sights[i]);
  return agreeing;
}

/// Bends drives so that they follow the map. @param registered  with drives in its frame.
void follow(const DriveSet& scans, const std::vector<FrameSight>& sights,
            RegisteredDrives& registered) {
  std::vector<std::vector<FoundScan>> found(registered.drives.size());
  for (const FrameSight& sight : sights) {
    const DriveSet::Place place = scans.place(sight.scan);
    // A scan of a tilted lidar is read upright.
    Eigen::Isometry3d T = sight.T_map_lidar;
    T.linear() = T.linear() * scans.R_scan_lidar(sight.scan).toRotationMatrix();
    found[place.drive].push_back({place.index, T, sight.covariance});
  }
  for (std::size_t i = 0; i < registered.drives.size(); ++i) {
    maps::Drive& drive = registered.drives[i];
    const std::vector<Eigen::Isometry3d>& poses = drive.contents().T_map_lidar;
    registered.known_by_map.push_back(known_by_map(poses, found[i]));
    drive = drive.with_poses(following(poses, found[i]), drive.contents().origin);
  }
}

}  // namespace

RegisteredDrives registered_to(const std::filesystem::path& folder, const DrivesToRegister& asked,
                               const MapBuildOptions& options, const ProgressCallback& progress,
                               const CancelFlag& cancel) {
  const auto& [drives, notes, odometry] = asked;
  const auto map = maps::MapPackage::open(folder);
  const DriveSet scans(drives, options, {}, notes);
  const FrameSearch search(map, scans, options.threads, progress, cancel);
  const auto claim = claimed(map->manifest(), drives.front(), odometry);
  const Eigen::Isometry3d start = find(folder, search, claim);
  const std::vector<std::size_t> measured = search.to_measure(start, options.follows_map);
  const std::vector<FrameSight> sights = search.localize(measured, start);
  const FrameFit fit = fit_frames(sights, start, kAgreed);
  require_agreement(folder, sights, fit, measured.size());

  RegisteredDrives registered;
  maps::Registration& registration = registered.frame.registration;
  registration.previous_digest = map->digest();
  registration.T_map_poses = fit.T_map_own;
  if (claim && odometry == "given" && !options.follows_map) {
    const Eigen::Isometry3d T_map_claimed = maps::renormalized(fit.T_map_own * claim->inverse());
    if (leaves_in_place(T_map_claimed, scans, *claim)) {
      registration.T_map_poses = *claim;
      registration.T_previous_map = T_map_claimed;
    }
  }
  registration.residual_m = fit.residual_m;
  registration.residual_rad = fit.residual_rad;
  registration.scans_used = fit.agreeing;
  registration.scans_asked = measured.size();
  registered.drives = moved(drives, registration.T_map_poses, map->manifest().geodetic_origin);
  if (options.follows_map) follow(scans, agreeing(sights, fit), registered);
  registered.frame.frame_id = map->manifest().frame_id;
  registered.frame.origin = map->manifest().origin;
  return registered;
}

}  // namespace stillmap::mapping
