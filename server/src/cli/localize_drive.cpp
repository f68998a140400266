#include <fmt/core.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <map>
#include <numbers>
#include <stdexcept>
#include <stillmap/localization/movable.hpp>
#include <stillmap/localization/tracker.hpp>
#include <stillmap/maps/box.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/trajectory.hpp>
#include <string>
#include <system_error>
#include <vector>

#include "cli/localize.hpp"
#include "command_line/progress_bar.hpp"
#include "command_line/run_program.hpp"
#include "command_line/table.hpp"
#include "json/json_values.hpp"

namespace stillmap::cli {
namespace {

using Clock = std::chrono::steady_clock;
using localization::PoseStatus;

/// A prior from the command line is off by no more than the localizer looks around it: three
/// deviations are 6 m and 0.39 rad.
constexpr double kPriorM = 2.0;
constexpr double kPriorRad = 0.13;

double seconds_since(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

/// What came of a drive.
class Tally {
 public:
  void add(const localization::TrackedPose& pose, double milliseconds) {
    ++status_[std::string(localization::name_of(pose.result.status))];
    ++searched_from_[std::string(localization::name_of(pose.searched_from))];
    for (const localization::Reason reason : pose.result.reasons)
      ++reasons_[std::string(localization::name_of(reason))];
    without_ok_ = pose.result.status == PoseStatus::kOk ? 0 : without_ok_ + 1;
    longest_without_ok_ = std::max(longest_without_ok_, without_ok_);
    milliseconds_.push_back(milliseconds);
  }
  void add_movable_points(std::size_t points) { movable_points_ += points; }

  [[nodiscard]] bool found_any() const { return status_.at("lost") < milliseconds_.size(); }

  [[nodiscard]] server::Json json() const {
    server::Json json;
    json["scans"] = milliseconds_.size();
    json["status"] = {{"ok", status_.at("ok")},
                      {"degraded", status_.at("degraded")},
                      {"lost", status_.at("lost")}};
    json["reasons"] = reasons_;
    json["searched_from"] = searched_from_;
    json["longest_without_ok"] = longest_without_ok_;
    json["movable_points"] = movable_points_;
    json["ms"] = {{"p50", percentile(0.5)}, {"p95", percentile(0.95)}};
    return json;
  }

  void print(double seconds) const {
    command_line::Table table;
    for (const char* name : {"ok", "degraded", "lost"}) {
      table.add(name, command_line::grouped(status_.at(name)));
    }
    for (const auto& [reason, count] : reasons_) {
      table.add("reason " + reason, command_line::grouped(count));
    }
    table.add("scans in a row without ok", fmt::format("{} at most", longest_without_ok_));
    if (movable_points_ > 0) table.add("points in boxes", command_line::grouped(movable_points_));
    table.add("time per scan", fmt::format("median {:.1f} ms, 95 % below {:.1f} ms",
                                           percentile(0.5), percentile(0.95)));
    table.add("time", fmt::format("{:.1f} s", seconds));
    table.print();
  }

 private:
  [[nodiscard]] double percentile(double share) const {
    if (milliseconds_.empty()) return 0.0;
    std::vector<double> sorted = milliseconds_;
    std::sort(sorted.begin(), sorted.end());
    return sorted[static_cast<std::size_t>(share * static_cast<double>(sorted.size() - 1))];
  }

  std::map<std::string, std::size_t> status_{{"ok", 0}, {"degraded", 0}, {"lost", 0}};
  std::map<std::string, std::size_t> searched_from_;
  std::map<std::string, std::size_t> reasons_;
  std::size_t without_ok_ = 0;
  std::size_t longest_without_ok_ = 0;
  std::size_t movable_points_ = 0;
  std::vector<double> milliseconds_;
};

void print_line(std::size_t index, const localization::TrackedPose& pose) {
  std::string text = fmt::format("{:6d} {} {:<8}", index, pose.stamp_ns,
                                 localization::name_of(pose.result.status));
  if (pose.result.status != PoseStatus::kLost) {
    const Eigen::Vector3d t = pose.result.T_map_lidar.translation();
    const Eigen::Matrix3d R = pose.result.T_map_lidar.linear();
    text += fmt::format(" {:10.3f} {:10.3f} {:8.3f} m {:8.3f} deg", t.x(), t.y(), t.z(),
                        std::atan2(R(1, 0), R(0, 0)) * 180.0 / std::numbers::pi);
  }
  fmt::print("{}  {}\n", text, fmt::join(localization::names_of(pose.result.reasons), ","));
  std::fflush(stdout);
}

/// Replaces the file in one step.
void write_trajectory(const std::filesystem::path& file, std::vector<maps::StampedPose> poses) {
  std::filesystem::path partial = file;
  partial += ".partial";
  try {
    maps::write_tum_trajectory(partial, maps::Trajectory(std::move(poses)));
    std::filesystem::rename(partial, file);
  } catch (const std::filesystem::filesystem_error& error) {
    std::error_code ignored;
    std::filesystem::remove(partial, ignored);
    throw maps::StorageError(file.string(), error.code().message());
  } catch (...) {
    std::error_code ignored;
    std::filesystem::remove(partial, ignored);
    throw;
  }
}

server::Json options_json(const LocalizeArguments& arguments) {
  return {{"drive", arguments.what.string()},
          {"method", arguments.method},
          {"options", arguments.options.empty() ? "vehicle" : arguments.options},
          {"prior", arguments.prior.empty() ? server::Json() : server::Json(arguments.prior)},
          {"select", arguments.select.empty() ? "::" : arguments.select},
          {"boxes", arguments.boxes ? server::Json(arguments.boxes->string()) : server::Json()}};
}

void start_at(const Eigen::Isometry3d& T_map_prior, localization::Tracker& tracker) {
  Eigen::Matrix<double, 6, 1> variances;
  variances << Eigen::Vector3d::Constant(kPriorM * kPriorM),
      Eigen::Vector3d::Constant(kPriorRad * kPriorRad);
  tracker.initialize(T_map_prior, variances.asDiagonal());
}

/// @return points that were left out because they lie in boxes of this scan.
std::size_t leave_out(const maps::BoxSequence& boxes, maps::Scan& scan) {
  const auto found = boxes.by_scan.find(scan.index);
  if (found == boxes.by_scan.end()) return 0;
  const std::size_t points = scan.cloud.size();
  scan.cloud = localization::without_points_in(scan.cloud, found->second);
  return points - scan.cloud.size();
}

}  // namespace

void localize_drive(const LocalizeArguments& arguments,
                    const std::optional<Eigen::Isometry3d>& T_map_prior) {
  const Clock::time_point begin = Clock::now();
  command_line::cancel_on_signals();
  const auto selection = maps::Selection::parse(arguments.select.empty() ? "::" : arguments.select);
  const maps::Drive drive = maps::Drive::open(arguments.what);
  const std::vector<std::size_t> indices = selection.indices(drive.size());
  if (indices.empty()) {
    throw std::invalid_argument(
        fmt::format("--select: '{}' selects none of the {} scans; give another range",
                    arguments.select, drive.size()));
  }
  maps::BoxSequence boxes;
  if (arguments.boxes) {
    drive.require_own_numbers(*arguments.boxes);
    boxes = maps::read_boxes(*arguments.boxes, drive.size());
  }
  const OpenMap map = open_map(arguments);
  localization::Tracker tracker(map.aligner, map.options.tracker);
  if (T_map_prior) start_at(*T_map_prior, tracker);
  Tally tally;
  std::vector<maps::StampedPose> poses;
  const bool lines = !arguments.output && !arguments.json.replaces_text();
  {
    command_line::ProgressBar bar;
    for (std::size_t done = 0; done < indices.size(); ++done) {
      if (command_line::cancel_flag()) throw std::runtime_error("cancelled");
      maps::Scan scan = drive.read(indices[done]);
      const Clock::time_point scan_begin = Clock::now();
      tally.add_movable_points(leave_out(boxes, scan));
      const localization::TrackedPose pose = tracker.track(scan.stamp_ns, scan.cloud);
      tally.add(pose, 1e3 * seconds_since(scan_begin));
      if (pose.result.status != PoseStatus::kLost) {
        poses.push_back({pose.stamp_ns, pose.result.T_map_lidar});
      }
      if (lines) {
        print_line(indices[done], pose);
      } else {
        bar.update("localize", done + 1, indices.size());
      }
    }
  }
  if (arguments.output && tally.found_any()) write_trajectory(*arguments.output, std::move(poses));
  if (arguments.json.is_asked()) {
    server::Json json = tally.json();
    json["boxes_dropped"] = boxes.dropped;
    json["seconds"] = seconds_since(begin);
    json["map"] = {{"name", map.name}, {"digest", map.digest}};
    json["options"] = options_json(arguments);
    json["version"] = STILLMAP_VERSION;
    arguments.json.write(server::to_text(json, 2));
  }
  if (arguments.output && !arguments.json.replaces_text()) {
    tally.print(seconds_since(begin));
  }
  if (!tally.found_any()) throw command_line::ExitCode{exit_code::kFailed};
}

}  // namespace stillmap::cli
