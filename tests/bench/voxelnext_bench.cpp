// What the detector VoxelNeXt costs on scans of a drive.
//
//   voxelnext_bench DRIVE [--network lite|full|FILE] [--select begin:end:step] [--threads N]
//                   [--repeat N]
//
// For each part of the network, means over scans of the fastest repeat: active cells, products of
// numbers (only pairs of rows that exist), milliseconds on the wall of convolutions and of
// everything else. Then the rate of the convolutions for each thread, and its share of the rate of
// a dense product of matrices (512 x 512 floats, Eigen, compiled for this machine) on as many
// threads in the same run. Rates are by the processor's time, so that what else runs on the machine
// counts little. `lite` and `full` have random weights, whose heat maps are held so low that few
// boxes come out of them, as in a trained network. `full` is measured once more with spatial voxel
// pruning as published: half of the cells do not dilate where stages 2, 3 and 4 open.

#include "detection/voxelnext/voxelnext_detector.hpp"

#include "gemm_rate.hpp"
#include "support/voxelnext_weights.hpp"

#include <stillmap/mapping/ground.hpp>
#include <stillmap/maps/drive.hpp>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <tbb/global_control.h>
#include <CLI/CLI.hpp>

#include <sys/resource.h>

#include <algorithm>
#include <exception>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace stillmap::test {
namespace {

using mapping::VoxelNextBranch;
using mapping::VoxelNextConfig;
using maps::ObjectClass;

struct Request {
  std::filesystem::path drive;
  std::string network = "lite";
  std::string select = "::10";
  int threads = 2;
  int repeat = 5;
};

VoxelNextConfig config_of(bool full) {
  using enum mapping::VoxelFeature;
  VoxelNextConfig config;
  config.name = full ? "full" : "lite";
  config.z = full ? mapping::VoxelNextHeight::kLidar : mapping::VoxelNextHeight::kGround;
  config.sensor_height_m = full ? 1.8 : 0.0;
  config.range_m = full ? std::array{-50.4, -50.4, -3.0, 50.4, 50.4, 3.0}
                        : std::array{-50.4, -50.4, 0.15, 50.4, 50.4, 4.15};
  config.voxel_m = {0.1, 0.1, full ? 0.15 : 0.2};
  config.features = {kDx, kDy, kDz, kHeight, kUx, kUy};
  const int wide = full ? 128 : 96, blocks = full ? 2 : 1;
  config.stages = {{{16, blocks, 3},
                    {32, blocks, 3},
                    {64, blocks, 3},
                    {wide, blocks, 3},
                    {wide, blocks, 3},
                    {wide, blocks, 3}}};
  config.neck_channels = wide;
  config.head_kernel = 3;
  config.branches = {VoxelNextBranch::kHm,  VoxelNextBranch::kCenter, VoxelNextBranch::kCenterZ,
                     VoxelNextBranch::kDim, VoxelNextBranch::kRot,    VoxelNextBranch::kIou};
  config.heads.assign(full ? 6 : 3, {{ObjectClass::kCar, ObjectClass::kVan}});
  config.iou_rectifier.assign(2 * config.heads.size(), 0.5);
  config.calibration.resize(2 * config.heads.size());
  config.score_threshold.assign(2 * config.heads.size(), 0.1);
  return config;
}

/// What is measured, one after the other.
std::vector<mapping::VoxelNextWeights> weights_of(const std::string& network) {
  if (network != "lite" && network != "full") return {mapping::read_voxelnext_weights(network)};
  std::vector<mapping::VoxelNextWeights> out{
      random_weights(config_of(network == "full"), 1, Heat::kLow)};
  if (network == "full") {
    out.push_back(out.front());
    out.back().config.pruning = {0.5, 0.5, 0.5, 0.0, 0.0};
  }
  return out;
}

struct Costs {
  mapping::NetworkCosts parts;
  mapping::Seconds total;
  double boxes = 0.0;
  double points = 0.0;
};

Costs run(const mapping::VoxelNextDetector& detector, const maps::Scan& scan,
          const mapping::GroundResult& ground) {
  Costs out;
  {
    const mapping::Stopwatch stopwatch(out.total);
    const auto boxes = detector.detect(scan, ground, {.layer = {}, .costs = &out.parts});
    out.boxes = static_cast<double>(boxes.size());
  }
  out.points = static_cast<double>(scan.cloud.size());
  return out;
}

void add(mapping::Seconds& sum, const mapping::Seconds& seconds) {
  sum.wall += seconds.wall;
  sum.cpu += seconds.cpu;
}

/// Prints sums over scans as means, and the whole.
void print(const std::vector<Costs>& scans, const mapping::VoxelNextPruning& pruning, double gemm) {
  const auto count = static_cast<double>(scans.size());
  std::map<std::string, mapping::NetworkCosts::Part> sums;
  mapping::NetworkCosts::Part all;
  mapping::Seconds total;
  double boxes = 0.0, points = 0.0;
  for (const Costs& scan : scans) {
    for (const auto& [name, part] : scan.parts.parts) {
      for (mapping::NetworkCosts::Part* sum : {&sums[name], &all}) {
        add(sum->preparation, part.preparation);
        add(sum->convolution, part.convolution);
        sum->multiplications += part.multiplications;
        sum->sites += part.sites;
      }
    }
    add(total, scan.total);
    boxes += scan.boxes;
    points += scan.points;
  }
  fmt::print("{:8} {:>8} {:>8} {:>9} {:>9} {:>9} {:>7}\n", "part", "cells", "GMAC", "other ms",
             "conv ms", "GFLOP/s", "share");
  const auto line = [&](const std::string& name, const mapping::NetworkCosts::Part& part) {
    const double rate =
        part.convolution.cpu > 0.0 ? 2.0 * part.multiplications / part.convolution.cpu : 0.0;
    fmt::print("{:8} {:8.0f} {:8.3f} {:9.2f} {:9.2f} {:9.1f} {:6.1f}%\n", name,
               static_cast<double>(part.sites) / count, 1e-9 * part.multiplications / count,
               1e3 * part.preparation.wall / count, 1e3 * part.convolution.wall / count,
               1e-9 * rate, 100.0 * rate / gemm);
  };
  for (const auto& [name, part] : sums) line(name, part);
  line("all", all);
  fmt::print("scan, pruning {}: {:.1f} ms ({:.1f} ms of processor), {:.0f} points, {:.1f} boxes\n",
             fmt::join(pruning, " "), 1e3 * total.wall / count, 1e3 * total.cpu / count,
             points / count, boxes / count);
}

void measure(const Request& request) {
  const tbb::global_control threads(tbb::global_control::max_allowed_parallelism,
                                    static_cast<std::size_t>(request.threads));
  const std::vector<mapping::VoxelNextWeights> networks = weights_of(request.network);
  const std::vector<mapping::VoxelNextDetector> detectors(networks.begin(), networks.end());
  const maps::Drive drive = maps::Drive::open(request.drive);
  const auto segmenter = mapping::make_ground_segmenter();
  double gemm = gemm_flops(request.threads);
  std::vector<std::vector<Costs>> scans(detectors.size());
  for (const std::size_t index : maps::Selection::parse(request.select).indices(drive.size())) {
    const maps::Scan scan = drive.read(index);
    const mapping::GroundResult ground = segmenter->segment(scan.cloud);
    for (std::size_t network = 0; network < detectors.size(); ++network) {
      std::vector<Costs> tries;
      for (int k = 0; k < request.repeat; ++k)
        tries.push_back(run(detectors[network], scan, ground));
      scans[network].push_back(
          *std::ranges::min_element(tries, {}, [](const Costs& c) { return c.total.cpu; }));
    }
  }
  gemm = std::max(gemm, gemm_flops(request.threads));
  for (std::size_t network = 0; network < detectors.size(); ++network)
    print(scans[network], networks[network].config.pruning, gemm);
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  fmt::print("GEMM: {:.1f} GFLOP/s on each of {} threads; peak memory {:.0f} MiB\n", 1e-9 * gemm,
             request.threads, static_cast<double>(usage.ru_maxrss) / 1024.0);
}

}  // namespace
}  // namespace stillmap::test

int main(int argc, char** argv) {
  stillmap::test::Request request;
  CLI::App app("What the detector VoxelNeXt costs on scans of a drive.");
  app.add_option("drive", request.drive)->required();
  app.add_option("--network", request.network, "lite, full or a weights file");
  app.add_option("--select", request.select);
  app.add_option("--threads", request.threads)->check(CLI::Range(1, 256));
  app.add_option("--repeat", request.repeat)->check(CLI::Range(1, 1000));
  CLI11_PARSE(app, argc, argv);
  try {
    stillmap::test::measure(request);
  } catch (const std::exception& error) {
    fmt::print(stderr, "voxelnext_bench: {}\n", error.what());
    return 1;
  }
}
