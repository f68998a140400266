// Thinned scans (localization/thin_scan.md) beside whole ones, of a drive in a map.
// usage: thin_scans MAP DRIVE [HARD]
//
// Each scan is located from half a metre beside its given pose, and tracked, in three ways: whole,
// `exact`, `compact`. Prints how many answers of `exact` are those of the whole scan to the bit,
// the largest bodies, and how far poses of `compact` are off. Exit code 1 in any of these cases:
// - An answer of `exact` differs.
// - A body of `exact` has over 200 kB, 260 kB with times, or one of `compact` over 48 kB.
// - The poses of `compact` are off by over 1 mm (median) or 5 mm (95 %).
//
// HARD queries of each scan have priors that are off by up to 8 m and 40 degrees, each third by 30
// m more. Counted, of whole scans and of both profiles: how many are `ok`, `ok` and off by over 0.5
// m or 2 degrees, `ok` and beyond a protection level. The truth is the drive's poses.
#include <stillmap/localization/aligner.hpp>
#include <stillmap/localization/tracker.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/map_package.hpp>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <memory>
#include <random>
#include <span>
#include <string>
#include <vector>

namespace {

using namespace stillmap;
using namespace stillmap::localization;

bool are_equal(const AlignmentResult& a, const AlignmentResult& b) {
  return a.T_map_lidar.matrix() == b.T_map_lidar.matrix() && a.covariance == b.covariance &&
         a.status == b.status && a.reasons == b.reasons && a.inlier_ratio == b.inlier_ratio;
}

/// Answers of thinned scans beside those of whole ones.
struct Answers {
  int scans = 0, equal = 0, ok_whole = 0, ok_thin = 0;
  /// Where both have a pose [mm].
  std::vector<double> off_mm{};

  void add(const AlignmentResult& whole, const AlignmentResult& thin) {
    ++scans;
    equal += are_equal(whole, thin) ? 1 : 0;
    ok_whole += whole.status == PoseStatus::kOk ? 1 : 0;
    ok_thin += thin.status == PoseStatus::kOk ? 1 : 0;
    if (whole.status == PoseStatus::kLost || thin.status == PoseStatus::kLost) return;
    off_mm.push_back(1e3 *
                     (whole.T_map_lidar.translation() - thin.T_map_lidar.translation()).norm());
  }
  [[nodiscard]] double off(double share) {
    if (off_mm.empty()) return 0.0;
    std::sort(off_mm.begin(), off_mm.end());
    return off_mm[static_cast<std::size_t>(share * static_cast<double>(off_mm.size() - 1))];
  }
};

/// What becomes of hard queries.
struct Verdicts {
  int queries = 0, ok = 0, wrong = 0, beyond = 0, other_status = 0;

  void add(const AlignmentResult& result, const AlignmentResult& whole,
           const Eigen::Isometry3d& T_map_lidar) {
    constexpr double kWrongM = 0.5, kWrongRad = 0.035;
    ++queries;
    other_status += result.status != whole.status ? 1 : 0;
    if (result.status != PoseStatus::kOk) return;
    ++ok;
    const Eigen::Isometry3d off = T_map_lidar.inverse() * result.T_map_lidar;
    const Eigen::AngleAxisd turn(off.linear());
    wrong += off.translation().norm() > kWrongM || turn.angle() > kWrongRad ? 1 : 0;
    const Eigen::Vector3d t = off.translation().cwiseAbs();
    const ProtectionLevels& levels = result.protection;
    beyond += t.x() > levels.longitudinal_m || t.y() > levels.lateral_m || t.z() > levels.vertical_m
                  ? 1
                  : 0;
  }
  void print(const char* name) const {
    std::printf(
        "%-8s hard     %d queries: ok %d, wrong %d, beyond a level %d; %d other statuses "
        "than whole\n",
        name, queries, ok, wrong, beyond, other_status);
  }
};

/// A profile, by queries and by a session.
struct Profile {
  ThinProfile profile;
  Tracker session;
  Answers queries{}, tracked{};
  Verdicts hard{};
  std::size_t most_bytes = 0;

  Profile(ThinProfile which, const std::shared_ptr<const Aligner>& aligner)
      : profile(which), session(aligner) {}

  ThinScan sent(const maps::Scan& scan) {
    const std::vector<char> bytes = encode_thin_scan(view_of(scan.cloud), profile);
    most_bytes = std::max(most_bytes, bytes.size());
    return decode_thin_scan(std::as_bytes(std::span(bytes)), scan.source).scan;
  }
  void print(const char* name) {
    for (auto& [what, of] : {std::pair("queries", &queries), std::pair("session", &tracked)})
      std::printf(
          "%-8s %-8s %d of %d to the bit; ok %d (whole %d); off by %.2f mm (median), %.2f (95 "
          "%%)\n",
          name, what, of->equal, of->scans, of->ok_thin, of->ok_whole, of->off(0.5), of->off(0.95));
    std::printf("%-8s at most %zu bytes\n", name, most_bytes);
  }
};

Prior hard_prior(const Eigen::Isometry3d& T_map_lidar, int number, std::mt19937& random) {
  constexpr double kFarM = 30.0;
  std::uniform_real_distribution<double> off_m(-8.0, 8.0), turn_rad(-0.7, 0.7);
  Prior prior{T_map_lidar, std::nullopt};
  prior.T_map_lidar.translation() +=
      Eigen::Vector3d(off_m(random) + (number % 3 == 2 ? kFarM : 0.0), off_m(random), 0.0);
  prior.T_map_lidar.rotate(Eigen::AngleAxisd(turn_rad(random), Eigen::Vector3d::UnitZ()));
  return prior;
}

int compare(const char* map, const char* folder, int hard) {
  constexpr std::size_t kMostExact = 200'000, kMostExactWithTimes = 260'000;
  const auto package = maps::MapPackage::open(map);
  const std::shared_ptr<const Aligner> aligner = make_aligner("default", *package);
  const maps::Drive drive = maps::Drive::open(folder);
  Tracker session(aligner);
  Profile exact(ThinProfile::kExact, aligner), compact(ThinProfile::kCompact, aligner);
  bool has_times = false;
  Verdicts hard_whole;
  std::mt19937 random(1);
  for (std::size_t i = 0; i < drive.size(); ++i) {
    const maps::Scan scan = drive.read(i);
    has_times = has_times || !scan.cloud.time_offsets_s.empty();
    Prior prior{drive.T_map_lidar(i), std::nullopt};
    prior.T_map_lidar.translation() += Eigen::Vector3d(0.4, -0.3, 0.0);
    const AlignmentResult found = aligner->align(scan.cloud, prior);
    const AlignmentResult tracked = session.track(scan.stamp_ns, scan.cloud).result;
    for (Profile* each : {&exact, &compact}) {
      const ThinScan thin = each->sent(scan);
      each->queries.add(found, aligner->align_thin(thin, prior));
      each->tracked.add(tracked, each->session.track_thin(scan.stamp_ns, thin).result);
    }
    for (int k = 0; k < hard; ++k) {
      const Prior far = hard_prior(drive.T_map_lidar(i), k, random);
      const AlignmentResult whole = aligner->align(scan.cloud, far);
      hard_whole.add(whole, whole, drive.T_map_lidar(i));
      for (Profile* each : {&exact, &compact})
        each->hard.add(aligner->align_thin(each->sent(scan), far), whole, drive.T_map_lidar(i));
    }
  }
  exact.print("exact");
  compact.print("compact");
  if (hard > 0) {
    hard_whole.print("whole");
    exact.hard.print("exact");
    compact.hard.print("compact");
  }
  const bool holds = exact.queries.equal == exact.queries.scans &&
                     exact.tracked.equal == exact.tracked.scans &&
                     exact.most_bytes <= (has_times ? kMostExactWithTimes : kMostExact) &&
                     compact.most_bytes <= kMostCompactBytes && compact.queries.off(0.5) <= 1.0 &&
                     compact.queries.off(0.95) <= 5.0;
  if (!holds) std::printf("beyond a limit: see the head of thin_scans.cpp\n");
  return holds ? 0 : 1;
}

}  // namespace

int main(int count, char** words) {
  if (count < 3 || count > 4) {
    std::fprintf(stderr, "usage: thin_scans MAP DRIVE [HARD]\n");
    return 2;
  }
  try {
    return compare(words[1], words[2], count == 4 ? std::atoi(words[3]) : 0);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  }
}
