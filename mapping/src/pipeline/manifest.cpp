#include "pipeline/manifest.hpp"

#include "detection/onnx/onnx_config.hpp"
#include "detection/voxelnext/embedded_weights.hpp"
#include "pipeline/boxes_files.hpp"
#include "pipeline/build.hpp"

#include <stillmap/mapping/detector.hpp>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <map>
#include <numbers>
#include <optional>
#include <string>
#include <string_view>

namespace stillmap::mapping {
namespace {

std::string text_of(const maps::Selection& selection) {
  return fmt::format("{}:{}:{}", selection.begin,
                     selection.end ? std::to_string(*selection.end) : "", selection.step);
}

std::string switch_of(bool on) { return on ? "on" : "off"; }

constexpr std::string_view kOnnx = "onnx:";
constexpr std::string_view kVoxelNext = "voxelnext:";

/// File of a detector `onnx:FILE`.
std::optional<std::filesystem::path> onnx_description(const std::string& detector) {
  if (!detector.starts_with(kOnnx)) return std::nullopt;
  return detector.substr(kOnnx.size());
}

/// File of a detector `voxelnext:FILE`.
std::optional<std::filesystem::path> voxelnext_weights(const std::string& detector) {
  if (!detector.starts_with(kVoxelNext)) return std::nullopt;
  return detector.substr(kVoxelNext.size());
}

/// Files by their name alone: where they lay says nothing about the map.
std::string detector_text(const MapBuildOptions& options) {
  if (const auto description = onnx_description(options.detector))
    return std::string(kOnnx) + description->filename().string();
  if (const auto weights = voxelnext_weights(options.detector))
    return std::string(kVoxelNext) + weights->filename().string();
  const std::vector<std::filesystem::path> files = boxes_files(options.detector);
  if (files.empty()) return options.detector;
  std::string text = "boxes:";
  for (const std::filesystem::path& file : files)
    text += (text.back() == ':' ? "" : ",") + file.filename().string();
  return text;
}

/// Counts are whole numbers, so lengths are in millimetres and angles in thousandths of a degree.
std::map<std::string, std::uint64_t> counts_of(const GivenPosesResult& given) {
  const auto thousandths = [](double value) {
    return static_cast<std::uint64_t>(std::llround(1e3 * value));
  };
  constexpr double kDegrees = 180.0 / std::numbers::pi;
  std::map<std::string, std::uint64_t> counts{{"poses_neighbours_apart", given.neighbours_apart}};
  if (given.use != GivenPosesUse::kRefine) return counts;
  counts["poses_denied"] = given.errors.denied;
  counts["poses_moved_median_mm"] = thousandths(given.moved.median_m);
  counts["poses_moved_max_mm"] = thousandths(given.moved.max_m);
  counts["poses_moved_median_mdeg"] = thousandths(kDegrees * given.moved.median_rad);
  counts["poses_moved_max_mdeg"] = thousandths(kDegrees * given.moved.max_rad);
  return counts;
}

}  // namespace

std::map<std::string, std::string> texts_of(const MapBuildOptions& options) {
  const ProjectionOptions& projection = options.projection;
  return {
      {"select", text_of(options.selection)},
      {"poses", options.poses_file ? options.poses_file->filename().string() : "of the drive"},
      {"detector", detector_text(options)},
      {"sensor_height_m", options.ground.sensor_height_m
                              ? fmt::format("{}", *options.ground.sensor_height_m)
                              : "estimated"},
      {"movable", std::string(name_of(projection.policy))},
      {"ground_height", std::string(name_of(projection.ground_height))},
      {"margin_m", fmt::format("{}", projection.margin_m)},
      {"margin_up_m", fmt::format("{}", projection.margin_up_m)},
      {"fusion", switch_of(options.fusion)},
      {"edits", options.edits_file ? options.edits_file->filename().string() : "none"},
      {"fill", switch_of(options.fills_ground())},
      {"clean", options.clean},
      {"voxel_size_m", fmt::format("{}", options.voxel_size_m)},
      {"min_range_m", fmt::format("{}", options.min_range_m)},
      {"max_range_m", fmt::format("{}", options.max_range_m)},
  };
}

std::map<std::string, std::string> sources_of(const std::vector<maps::Drive>& drives,
                                              const MapBuildOptions& options) {
  std::map<std::string, std::string> sources;
  const auto numbered = [](const std::string& name, std::size_t i) {
    return i == 0 ? name : fmt::format("{}_{}", name, i + 1);
  };
  for (std::size_t i = 0; i < drives.size(); ++i)
    sources[numbered("drive", i)] =
        std::filesystem::weakly_canonical(drives[i].contents().root).filename().string();
  const std::vector<std::filesystem::path> boxes = boxes_files(options.detector);
  for (std::size_t i = 0; i < boxes.size(); ++i)
    sources[numbered("boxes_sha256", i)] = maps::sha256_of_file(boxes[i]);
  if (const auto description = onnx_description(options.detector)) {
    sources["onnx_description_sha256"] = maps::sha256_of_file(*description);
    sources["onnx_model_sha256"] = maps::sha256_of_file(read_onnx_config(*description).model);
  }
  if (const auto weights = voxelnext_weights(options.detector))
    sources["voxelnext_weights_sha256"] = maps::sha256_of_file(*weights);
  else if (options.detector == kVoxelNextDetector)
    sources["voxelnext_weights_sha256"] = embedded_weights_sha256();
  // A dump of another program is a folder, whose clouds are no poses.
  if (options.poses_file && std::filesystem::is_regular_file(*options.poses_file))
    sources["poses_sha256"] = maps::sha256_of_file(*options.poses_file);
  if (options.edits_file) sources["edits_sha256"] = maps::sha256_of_file(*options.edits_file);
  return sources;
}

std::map<std::string, std::string> texts_of(const TrajectoryOptions& options) {
  std::map<std::string, std::string> texts{{"loops", switch_of(options.loops)}};
  if (options.prior)
    texts["pose_sigma"] =
        fmt::format("{} m, {} rad", options.prior->sigma_m, options.prior->sigma_rad);
  if (options.gnss_sigma_m) texts["gnss_sigma_m"] = fmt::format("{}", *options.gnss_sigma_m);
  return texts;
}

/// What was added to the stamps of poses, one a drive; empty for nothing.
std::string pose_time_offsets_of(const DriveSet& drives, const MapBuildOptions& options,
                                 const MapBuildResult& result) {
  std::vector<double> offsets_s = result.found_pose_time_offsets_s;
  offsets_s.resize(drives.drives().size(), 0.0);
  for (double& offset_s : offsets_s) offset_s += options.pose_time_offset_s;
  const bool none = std::ranges::all_of(offsets_s, [](double offset_s) { return offset_s == 0.0; });
  return none ? "" : fmt::format("{:.4f}", fmt::join(offsets_s, ", "));
}

maps::MapManifest manifest_of(const Build& build) {
  const DriveSet& drives = *build.drives;
  const MapBuildOptions& options = build.task.options;
  const MapBuildResult& result = build.result;
  const bool is_given = build.task.odometry == "given";
  const maps::Drive& first = drives.drives().front();
  maps::MapManifest manifest;
  manifest.frame_id = first.contents().origin ? "enu" : "local";
  manifest.origin = build.grid->origin();
  manifest.geodetic_origin = first.contents().origin;
  manifest.voxel_size_m = options.voxel_size_m;
  manifest.relative_clock = first.relative_clock();
  manifest.software_version = STILLMAP_VERSION;
  manifest.options = texts_of(options);
  // Only where it is asked for: maps of earlier versions keep their digests.
  if (options.held_back_every > 0)
    manifest.options["held_back_every"] = fmt::format("{}", options.held_back_every);
  if (const std::string offsets = pose_time_offsets_of(drives, options, result); !offsets.empty())
    manifest.options["pose_time_offset_s"] = offsets;
  manifest.options["odometry"] = build.task.odometry;
  if (is_given) manifest.options["given_poses"] = std::string(name_of(options.given_poses));
  if (!is_given || options.given_poses == GivenPosesUse::kRefine) {
    for (auto& [name, text] : texts_of(options.trajectory)) manifest.options[name] = text;
  }
  manifest.counts = result.points;
  for (const auto& [name, count] : result.objects) manifest.counts["objects_" + name] = count;
  for (const auto& [name, count] : result.trajectory) manifest.counts[name] = count;
  if (const auto& given = result.given_poses)
    for (const auto& [name, count] : counts_of(*given)) manifest.counts[name] = count;
  manifest.counts["scans"] = result.scans;
  manifest.sources = sources_of(drives.drives(), options);
  if (const auto& frame = build.frame) {
    manifest.frame_id = frame->frame_id;
    manifest.registration = frame->registration;
    if (options.follows_map) manifest.options["follows_map"] = "on";
    manifest.sources["registered_to"] = frame->registration.previous_digest;
  }
  return manifest;
}

}  // namespace stillmap::mapping
