// What free-space cleaning takes from the scans of labelled drives: of what moved, and of what
// stayed.
//
//     measure_cleaning DRIVE... [--detector geometric] [--voxel 0.1] [--threads N] [--dump FILE]
//                      [--off METRES]
//
// Labels are SemanticKITTI's (252 to 259 move). Poses are the drives' own; several drives are days
// of one place; --off shifts all but the first, as if they were registered badly. Without a
// detector every object stays in the map; with one its points leave it.
//
// DA: share of the points of what moved, within 50 m of the sensor, with no point of the cleaned,
// unthinned map within 0.05 m. Static loss: share of points of what stays with no point of the
// thinned map within 0.1 m, less the same of the map before cleaning.

#include "cleaning/free_space_cleaner.hpp"
#include "pipeline/scan_work.hpp"

#include <fmt/format.h>
#include <CLI/CLI.hpp>
#include <stillmap/mapping/detector.hpp>
#include <stillmap/mapping/projection.hpp>
#include <stillmap/maps/drive.hpp>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <optional>
#include <unordered_map>
#include <vector>

namespace {

using namespace stillmap;
using mapping::CleaningPoints;

constexpr float kRangeM = 50.0F;
constexpr float kRemovedM = 0.05F;
constexpr float kLostM = 0.1F;
constexpr std::array<float, 2> kUsedM = {2.7F, 80.0F};

enum class Truth { kUnknown, kStatic, kMovable, kMoving };
Truth truth_of(std::uint32_t label) {
  if (label >= 252 && label <= 259) return Truth::kMoving;
  if (label <= 1) return Truth::kUnknown;
  return label >= 10 && label < 40 ? Truth::kMovable : Truth::kStatic;
}

struct Point {
  Eigen::Vector3f p;
  std::uint32_t voxel;
  std::uint16_t label;
  bool near, in_map;
};

struct Voxel {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  std::uint32_t points = 0, ground = 0, scans = 0, last_scan = 0;
};

using Cell = std::uint64_t;
Cell key(const Eigen::Vector3i& c) {
  constexpr std::uint64_t kMask = (1U << 21U) - 1;
  return ((static_cast<std::uint64_t>(c.x()) & kMask) << 42U) |
         ((static_cast<std::uint64_t>(c.y()) & kMask) << 21U) |
         (static_cast<std::uint64_t>(c.z()) & kMask);
}

/// Scans of several drives, labelled, stacked into voxels.
class Drives final : public mapping::ScanSource {
 public:
  Drives(const std::vector<std::string>& folders, const std::string& detector, double voxel_m,
         double off_m)
      : voxel_m_(voxel_m), off_m_(off_m), ground_(mapping::make_ground_segmenter()) {
    for (const std::string& folder : folders) {
      drives_.push_back(maps::Drive::open(folder));
      const maps::Drive& drive = drives_.back();
      detectors_.push_back(detector.empty() ? nullptr
                                            : mapping::make_detector(detector, drive.size()));
      for (std::size_t i = 0; i < drive.size(); ++i) places_.emplace_back(drives_.size() - 1, i);
    }
    origin_ = drives_.front().T_map_lidar(0).translation().array().floor();
    for (std::uint32_t scan = 0; scan < size(); ++scan) stack(scan);
  }

  [[nodiscard]] std::size_t size() const override { return places_.size(); }
  [[nodiscard]] Eigen::Isometry3d T_local_lidar(std::size_t scan) const override {
    const auto [drive, index] = places_.at(scan);
    Eigen::Isometry3d T = drives_[drive].T_map_lidar(index);
    T.translation() -= origin_;
    if (drive > 0) T.translation() += Eigen::Vector3d(0.7, -0.7, 0.14) * off_m_;
    return T;
  }
  [[nodiscard]] mapping::PosedScan read(std::size_t scan) const override {
    return load(scan).posed;
  }
  [[nodiscard]] const std::vector<Point>& points() const { return points_; }
  [[nodiscard]] CleaningPoints map() const {
    CleaningPoints map;
    map.voxel_size_m = voxel_m_;
    for (const Voxel& v : voxels_) {
      map.positions.push_back((v.sum / v.points).cast<float>());
      map.is_ground.push_back(2 * v.ground > v.points ? 1 : 0);
      map.scans.push_back(v.scans);
    }
    return map;
  }
  /// Number of the voxel that holds p, if any.
  [[nodiscard]] std::optional<std::uint32_t> voxel_at(const Eigen::Vector3i& cell) const {
    const auto at = index_.find(key(cell));
    return at == index_.end() ? std::nullopt : std::optional(at->second);
  }
  [[nodiscard]] Eigen::Vector3i cell_of(const Eigen::Vector3d& p) const {
    return (p / voxel_m_).array().floor().cast<int>();
  }

 private:
  struct Loaded {
    mapping::PosedScan posed;
    std::vector<std::uint16_t> labels;
  };

  [[nodiscard]] Loaded load(std::size_t scan) const {
    const auto [drive, index] = places_.at(scan);
    maps::Scan read = drives_[drive].read(index);
    const std::vector<std::uint32_t> labels = drives_[drive].read_labels(index);
    if (labels.size() != read.cloud.size())
      throw std::runtime_error(read.source + ": labels are not one a point");
    Loaded loaded;
    maps::PointCloud kept;
    for (std::size_t i = 0; i < read.cloud.size(); ++i) {
      const float range_m = read.cloud.positions[i].norm();
      if (range_m < kUsedM[0] || range_m > kUsedM[1]) continue;
      kept.positions.push_back(read.cloud.positions[i]);
      loaded.labels.push_back(static_cast<std::uint16_t>(labels[i]));
    }
    read.cloud = kept;
    const mapping::GroundResult ground = ground_->segment(read.cloud);
    loaded.posed = {T_local_lidar(scan), read.cloud.positions, ground.is_ground, {}};
    loaded.posed.in_object.resize(read.cloud.size());
    if (detectors_[drive] != nullptr) {
      const auto boxes = detectors_[drive]->detect(read, ground);
      mapping::ProjectionOptions options;
      options.policy = mapping::MovablePolicy::kDelete;
      const auto projected = mapping::project_objects(read.cloud, ground, boxes, options);
      for (std::size_t i = 0; i < read.cloud.size(); ++i) {
        loaded.posed.in_object[i] = projected.fates[i] == mapping::PointFate::kDeleted ? 1 : 0;
      }
    }
    return loaded;
  }

  void stack(std::uint32_t scan) {
    const Loaded loaded = load(scan);
    for (std::size_t i = 0; i < loaded.labels.size(); ++i) {
      const Eigen::Vector3d p =
          loaded.posed.T_local_lidar * loaded.posed.positions[i].cast<double>();
      const bool near = loaded.posed.positions[i].norm() < kRangeM;
      Point point{p.cast<float>(), 0, loaded.labels[i], near, loaded.posed.in_object[i] == 0};
      if (point.in_map) {
        const auto [at, inserted] =
            index_.try_emplace(key(cell_of(p)), static_cast<std::uint32_t>(voxels_.size()));
        if (inserted) voxels_.emplace_back();
        Voxel& voxel = voxels_[at->second];
        voxel.sum += p;
        ++voxel.points;
        voxel.ground += loaded.posed.is_ground[i];
        if (voxel.scans == 0 || voxel.last_scan != scan) ++voxel.scans;
        voxel.last_scan = scan;
        point.voxel = at->second;
      }
      points_.push_back(point);
    }
  }

  double voxel_m_;
  double off_m_;
  Eigen::Vector3d origin_;
  std::unique_ptr<mapping::GroundSegmenter> ground_;
  std::vector<maps::Drive> drives_;
  std::vector<std::unique_ptr<mapping::Detector>> detectors_;
  std::vector<std::pair<std::size_t, std::size_t>> places_;
  std::vector<Point> points_;
  std::vector<Voxel> voxels_;
  std::unordered_map<Cell, std::uint32_t> index_;
};

/// Calls `take(voxel number)` for the 27 voxels around p that hold something.
template <typename Take>
void around(const Drives& drives, const Eigen::Vector3f& p, const Take& take) {
  const Eigen::Vector3i centre = drives.cell_of(p.cast<double>());
  for (int n = 0; n < 27; ++n) {
    if (const auto v =
            drives.voxel_at(centre + Eigen::Vector3i(n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1)))
      take(*v);
  }
}

/// Share of what moved that left, by label.
void print_removed(const Drives& drives, const std::vector<std::uint8_t>& gone) {
  std::unordered_map<std::uint32_t, std::vector<Eigen::Vector3f>> left;
  for (const Point& q : drives.points()) {
    if (q.in_map && gone[q.voxel] == 0 && truth_of(q.label) == Truth::kMoving) left[q.voxel];
  }
  const auto watch = [&](const Point& q) {
    around(drives, q.p, [&](std::uint32_t v) { left[v]; });
  };
  for (const Point& q : drives.points()) {
    if (truth_of(q.label) == Truth::kMoving) watch(q);
  }
  for (const Point& q : drives.points()) {
    if (!q.in_map || gone[q.voxel] != 0) continue;
    if (const auto at = left.find(q.voxel); at != left.end()) at->second.push_back(q.p);
  }
  std::map<std::uint16_t, std::array<std::size_t, 2>> counts;
  for (const Point& q : drives.points()) {
    if (!q.near || truth_of(q.label) != Truth::kMoving) continue;
    bool matched = false;
    around(drives, q.p, [&](std::uint32_t v) {
      const auto at = left.find(v);
      if (at == left.end() || matched) return;
      matched = std::any_of(at->second.begin(), at->second.end(), [&](const Eigen::Vector3f& m) {
        return (m - q.p).squaredNorm() < kRemovedM * kRemovedM;
      });
    });
    auto& count = counts[q.label];
    ++count[0];
    if (!matched) ++count[1];
  }
  std::array<std::size_t, 2> all{};
  for (const auto& [label, count] : counts) {
    all[0] += count[0];
    all[1] += count[1];
    fmt::print("  moving {}: {} points, DA {:.4f}\n", label, count[0],
               static_cast<double>(count[1]) / static_cast<double>(count[0]));
  }
  fmt::print("DA {:.4f} of {} points\n",
             static_cast<double>(all[1]) / std::max(1.0, static_cast<double>(all[0])), all[0]);
}

/// Share of what stays that was lost, by label, and of what is parked.
void print_lost(const Drives& drives, const CleaningPoints& map,
                const std::vector<std::uint8_t>& gone) {
  constexpr std::size_t kEvery = 5;
  struct Count {
    std::size_t points = 0, lost = 0, lost_before = 0;
  };
  std::map<std::uint16_t, Count> counts;
  Count all;
  for (std::size_t i = 0; i < drives.points().size(); i += kEvery) {
    const Point& q = drives.points()[i];
    const Truth truth = truth_of(q.label);
    if (truth == Truth::kUnknown || truth == Truth::kMoving) continue;
    bool before = false, after = false;
    around(drives, q.p, [&](std::uint32_t v) {
      if ((map.positions[v] - q.p).squaredNorm() > kLostM * kLostM) return;
      before = true;
      if (gone[v] == 0) after = true;
    });
    for (Count* count : {&counts[q.label], truth == Truth::kStatic ? &all : nullptr}) {
      if (count == nullptr) continue;
      ++count->points;
      if (!before) ++count->lost_before;
      if (!after) ++count->lost;
    }
  }
  const auto share = [](const Count& c) {
    return static_cast<double>(c.lost - c.lost_before) /
           std::max(1.0, static_cast<double>(c.points));
  };
  for (const auto& [label, count] : counts)
    fmt::print("  label {}: {} points, lost {:.5f}\n", label, count.points, share(count));
  fmt::print("static loss {:.5f} of {} points\n", share(all), all.points);
}

void dump(const std::string& file, const Drives& drives, const CleaningPoints& map,
          const std::vector<std::uint8_t>& gone) {
  std::vector<std::uint16_t> label(map.positions.size());
  for (const Point& q : drives.points()) {
    if (q.in_map) label[q.voxel] = q.label;
  }
  std::ofstream stream(file, std::ios::binary);
  for (std::size_t i = 0; i < map.positions.size(); ++i) {
    const Eigen::Vector3f& p = map.positions[i];
    const std::array<float, 7> row = {p.x(),
                                      p.y(),
                                      p.z(),
                                      static_cast<float>(label[i]),
                                      static_cast<float>(map.is_ground[i]),
                                      static_cast<float>(map.scans[i]),
                                      static_cast<float>(gone[i])};
    stream.write(reinterpret_cast<const char*>(row.data()), sizeof row);
  }
}

}  // namespace

int main(int argc, char** argv) try {
  CLI::App app{"what free-space cleaning takes from labelled drives"};
  std::vector<std::string> folders;
  std::string detector, dump_file;
  double voxel_m = 0.1, off_m = 0.0;
  int threads = 1;
  app.add_option("drives", folders)->required();
  app.add_option("--detector", detector);
  app.add_option("--voxel", voxel_m);
  app.add_option("--threads", threads);
  app.add_option("--off", off_m);
  app.add_option("--dump", dump_file);
  CLI11_PARSE(app, argc, argv);
  const Drives drives(folders, detector, voxel_m, off_m);
  const CleaningPoints map = drives.map();
  const mapping::FreeSpaceCleaner cleaner(std::filesystem::temp_directory_path(), threads);
  std::map<std::string, std::clock_t> began, ended;
  const auto progress = [&](std::string_view stage, std::size_t, std::size_t) {
    began.try_emplace(std::string(stage), std::clock());
    ended[std::string(stage)] = std::clock();
  };
  const std::vector<std::uint8_t> gone = cleaner.moved(map, drives, progress, false);
  fmt::print("{} scans, {} map points, {} gone; cleaning took {:.1f} ms of CPU a scan\n",
             drives.size(), map.positions.size(), std::count(gone.begin(), gone.end(), 1),
             1e3 * static_cast<double>(ended["clean"] - ended["views"]) / CLOCKS_PER_SEC /
                 static_cast<double>(drives.size()));
  print_removed(drives, gone);
  print_lost(drives, map, gone);
  if (!dump_file.empty()) dump(dump_file, drives, map, gone);
  return 0;
} catch (const std::exception& error) {
  fmt::print(stderr, "{}\n", error.what());
  return 1;
}
