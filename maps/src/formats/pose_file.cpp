#include <stillmap/maps/pose_file.hpp>

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <span>
#include <string_view>
#include <utility>

#include <stillmap/maps/text.hpp>
#include "formats/hdl_keyframe.hpp"
#include "formats/pose_line.hpp"
#include "formats/pose_table.hpp"

namespace stillmap::maps {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kKnownLines =
    "8 numbers (TUM: stamp tx ty tz qx qy qz qw), 12 (KITTI: the 3x4 matrix), 13 (the number of "
    "the scan before it), or a header that names columns, such as timestamp,x,y,z,qx,qy,qz,qw: "
    "write one of these";
/// Smaller ones are numbers of scans.
constexpr double kLeastStamp = 1e8;

/// Lines of a file of poses, one after the other.
class PoseLines {
 public:
  explicit PoseLines(const fs::path& file) : file_(file) {}

  void read(std::string_view text) {
    while (const std::optional<std::string_view> line = take_line(text)) {
      ++line_;
      const std::vector<std::string_view> words = split_fields(*line, 2);
      if (words.empty()) continue;
      const char first = words.front().front();
      if (first == '#' || first == '%')
        take_comment(*line);
      else
        take(*line, words.front());
    }
  }

  void require_some() const {
    if (!pose_file_.poses.empty()) return;
    throw InputError(file_.string(), skipped_ > 0 ? "a graph without VERTEX_SE3:QUAT" : "no poses",
                     "poses as KITTI, TUM, CSV or g2o: give another file, or take it away");
  }

  [[nodiscard]] PoseFile result() {
    if (stamps_ns_.empty()) return std::move(pose_file_);
    std::vector<StampedPose> stamped;
    for (std::size_t i = 0; i < stamps_ns_.size(); ++i)
      stamped.push_back({stamps_ns_[i], pose_file_.poses[i]});
    pose_file_.poses.clear();
    pose_file_.stamped = Trajectory(std::move(stamped));
    return std::move(pose_file_);
  }

 private:
  enum class Kind { kUndecided, kNumbers, kTable, kGraph };

  /// A header may be a comment, as in EuRoC's files.
  void take_comment(std::string_view line) {
    if (kind_ != Kind::kUndecided) return;
    const auto header = parse_pose_header(line, where());
    if (header && !is_tum(*header)) columns_ = header;
  }

  static bool is_tum(const PoseColumns& header) {
    return header.count == 8 && header.stamp == 0U && !header.stamp_unit && header.is_quaternion &&
           header.position == std::array<std::size_t, 3>{1, 2, 3} &&
           header.rotation == std::array<std::size_t, 4>{4, 5, 6, 7};
  }

  void take(std::string_view line, std::string_view first_word) {
    if (kind_ == Kind::kUndecided) {
      if (starts_graph(first_word)) {
        kind_ = Kind::kGraph;
        pose_file_.format = "g2o";
      } else {
        separator_ = separator_of(line);
        const auto cells = split_cells(line, separator_);
        if (!columns_ && !cells.empty() && !parse_number(cells.front())) return take_header(line);
        kind_ = columns_ ? Kind::kTable : Kind::kNumbers;
      }
    }
    if (kind_ == Kind::kGraph) return take_vertex(line, first_word);
    const std::vector<std::string_view> cells = split_cells(line, separator_);
    if (kind_ == Kind::kTable) return take_row(cells);
    take_numbers(cells);
  }

  static bool starts_graph(std::string_view word) {
    return word.starts_with("VERTEX") || word.starts_with("EDGE") || word.starts_with("PARAMS") ||
           word == "FIX";
  }

  void take_header(std::string_view line) {
    columns_ = parse_pose_header(line, where());
    if (!columns_) throw InputError(where(), quoted(line), std::string(kKnownLines));
    kind_ = Kind::kTable;
  }

  [[nodiscard]] std::string where() const { return place(file_, line_); }

  [[nodiscard]] double number(std::string_view cell) const {
    const std::optional<double> value = parse_number(cell);
    if (!value || !std::isfinite(*value))
      throw InputError(where(), quoted(cell), "a finite number: correct the line");
    return *value;
  }

  template <std::size_t N>
  [[nodiscard]] std::array<double, N> numbers(std::span<const std::string_view> cells) const {
    std::array<double, N> values{};
    for (std::size_t i = 0; i < N; ++i) values[i] = number(cells[i]);
    return values;
  }

  void add_stamp(std::optional<std::int64_t> stamp_ns, std::string_view cell) {
    if (!stamp_ns)
      throw InputError(where(), "stamp " + quoted(cell),
                       "seconds that fit 64 bits of nanoseconds: write stamps in seconds");
    if (!stamps_ns_.empty() && *stamp_ns <= stamps_ns_.back())
      throw InputError(
          where(), "stamp " + quoted(cell),
          "one after that of the line before: sort the lines, and keep one of each stamp");
    stamps_ns_.push_back(*stamp_ns);
  }

  void add_stamp(std::string_view cell) {
    if (!unit_) unit_ = unit_of_stamp(cell);
    add_stamp(parse_stamp(cell, *unit_), cell);
  }

  void add_number(std::string_view cell) {
    // "12", and "12.0000" as numpy writes it.
    const double value = number(cell);
    if (!(value >= 0.0 && value < kLeastStamp && value == std::floor(value)))
      throw InputError(where(), quoted(cell) + " as the number of a scan",
                       "a whole number: correct the line");
    const auto scan = static_cast<std::size_t>(value);
    pose_file_.numbers.push_back(scan);
  }

  void take_numbers(const std::vector<std::string_view>& cells) {
    const std::size_t count = cells.size();
    const bool is_first = pose_file_.poses.empty();
    if (is_first) {
      count_ = count;
      if (count == 12 || count == 16) pose_file_.format = "kitti";
      if (count == 8) pose_file_.format = "tum";
      if (count == 13 || count == 17) {
        numbered_ = number(cells.front()) < kLeastStamp;
        pose_file_.format = numbered_ ? "kitti360" : "csv";
      }
      if (pose_file_.format.empty())
        throw InputError(where(), fmt::format("{} fields", count), std::string(kKnownLines));
    }
    if (count != count_)
      throw InputError(where(), fmt::format("{} fields", count),
                       fmt::format("{}, as in the lines before: correct the line", count_));
    // The line is all that ties such a pose to its scan, so a hole would shift all that follow.
    if (pose_file_.format == "kitti" && line_ != last_line_ + 1)
      throw InputError(place(file_, last_line_ + 1), "a blank line or comment",
                       "12 numbers: remove it");
    last_line_ = line_;
    std::span<const std::string_view> rest = cells;
    if (pose_file_.format != "kitti") {
      if (numbered_)
        add_number(cells.front());
      else
        add_stamp(cells.front());
      rest = rest.subspan(1);
    }
    pose_file_.poses.push_back(rest.size() == 7 ? pose_of_quaternion(file_, line_, numbers<7>(rest))
                                                : pose_of_matrix(file_, line_, matrix_of(rest)));
  }

  /// The upper three rows.
  [[nodiscard]] std::array<double, 12> matrix_of(std::span<const std::string_view> cells) const {
    if (cells.size() == 16) {
      const auto last = numbers<4>(cells.subspan(12));
      if (last != std::array<double, 4>{0.0, 0.0, 0.0, 1.0})
        throw InputError(where(), fmt::format("the last row {}", fmt::join(last, " ")),
                         "0 0 0 1: write the lines as the 4x4 matrix, row by row");
    }
    return numbers<12>(cells);
  }

  void take_row(const std::vector<std::string_view>& cells) {
    const PoseColumns& columns = *columns_;
    // Cells at the end may be empty. Blanks do not show which one is.
    const std::size_t least = separator_ == ' ' ? columns.count : columns.last() + 1;
    if (cells.size() < least || cells.size() > columns.count)
      throw InputError(
          where(), fmt::format("{} fields", cells.size()),
          fmt::format("{}, as the header names: correct the line or the header", columns.count));
    pose_file_.format = "csv";
    if (columns.nanoseconds) {
      add_seconds_and_nanoseconds(cells[*columns.stamp], cells[*columns.nanoseconds]);
    } else if (columns.stamp) {
      if (columns.stamp_unit) unit_ = columns.stamp_unit;
      add_stamp(cells[*columns.stamp]);
    } else if (columns.number) {
      add_number(cells[*columns.number]);
    }
    std::array<double, 7> n{};
    for (std::size_t i = 0; i < 3; ++i) n[i] = number(cells[columns.position[i]]);
    const Eigen::Quaterniond q = rotation_of(cells);
    n[3] = q.x();
    n[4] = q.y();
    n[5] = q.z();
    n[6] = q.w();
    pose_file_.poses.push_back(pose_of_quaternion(file_, line_, n));
  }

  void add_seconds_and_nanoseconds(std::string_view seconds, std::string_view nanoseconds) {
    const auto whole_ns = parse_stamp(seconds, StampUnit::kSeconds);
    const auto rest_ns = parse_stamp(nanoseconds, StampUnit::kNanoseconds);
    std::int64_t stamp_ns = 0;
    if (rest_ns && (*rest_ns < 0 || *rest_ns >= 1'000'000'000))
      throw InputError(where(), quoted(nanoseconds) + " beside seconds",
                       "nanoseconds below 1e9: remove one of the two columns of stamps");
    const bool fits =
        whole_ns && rest_ns && !__builtin_add_overflow(*whole_ns, *rest_ns, &stamp_ns);
    add_stamp(fits ? std::optional(stamp_ns) : std::nullopt, seconds);
  }

  [[nodiscard]] Eigen::Quaterniond rotation_of(const std::vector<std::string_view>& cells) const {
    const PoseColumns& columns = *columns_;
    std::array<double, 4> r{};
    for (std::size_t i = 0; i < (columns.is_quaternion ? 4U : 3U); ++i)
      r[i] = number(cells[columns.rotation[i]]);
    if (columns.is_quaternion) return {r[3], r[0], r[1], r[2]};
    constexpr double kTurn = 2.0 * std::numbers::pi;
    for (std::size_t i = 0; i < 3; ++i) {
      const std::optional<double>& unit_rad = columns.angle_unit_rad[i];
      if (!unit_rad && std::abs(r[i]) > kTurn)
        throw InputError(where(), fmt::format("an angle of {:g}, and no unit in the header", r[i]),
                         "radians, or the unit in the header: name the columns roll_deg, pitch_deg "
                         "and yaw_deg");
      r[i] *= unit_rad.value_or(1.0);
    }
    return Eigen::AngleAxisd(r[2], Eigen::Vector3d::UnitZ()) *
           Eigen::AngleAxisd(r[1], Eigen::Vector3d::UnitY()) *
           Eigen::AngleAxisd(r[0], Eigen::Vector3d::UnitX());
  }

  void take_vertex(std::string_view line, std::string_view first_word) {
    if (first_word != "VERTEX_SE3:QUAT") {
      ++skipped_;
      return;
    }
    const std::vector<std::string_view> cells = split_fields(line, 10);
    if (cells.size() < 9)
      throw InputError(where(), fmt::format("{} fields", cells.size()),
                       "VERTEX_SE3:QUAT id x y z qx qy qz qw: correct the line");
    add_number(cells[1]);
    pose_file_.poses.push_back(
        pose_of_quaternion(file_, line_, numbers<7>(std::span(cells).subspan(2, 7))));
  }

  const fs::path& file_;
  std::size_t line_ = 0, last_line_ = 0;
  Kind kind_ = Kind::kUndecided;
  char separator_ = ' ';
  std::optional<PoseColumns> columns_;
  std::optional<StampUnit> unit_;
  std::size_t count_ = 0, skipped_ = 0;
  bool numbered_ = false;
  PoseFile pose_file_;
  std::vector<std::int64_t> stamps_ns_;
};

/// @return no poses for a file without lines.
PoseFile read_lines_of(const fs::path& file, std::string_view format, const std::string& wanted) {
  PoseLines lines(file);
  lines.read(read_text(file));
  PoseFile poses = lines.result();
  if (!poses.format.empty() && poses.format != format)
    throw InputError(file.string(), "poses in the format " + poses.format,
                     wanted + ": give a file of this format");
  return poses;
}

/// A pose belongs to one scan.
void require_single_numbers(const PoseFile& poses, const fs::path& file) {
  std::vector<std::size_t> numbers = poses.numbers;
  std::sort(numbers.begin(), numbers.end());
  if (const auto twice = std::adjacent_find(numbers.begin(), numbers.end()); twice != numbers.end())
    throw InputError(file.string(), fmt::format("two poses of scan {}", *twice),
                     "one of each scan: remove the other");
}

/// The folder that a SLAM program dumped.
PoseFile read_dump(const fs::path& folder) {
  PoseFile poses;
  if (const fs::path file = folder / "traj_lidar.txt"; fs::exists(file)) {
    poses = read_pose_file(file);
    poses.format = "glim";
    return poses;
  }
  const std::vector<HdlKeyframe> keyframes = read_hdl_keyframes(folder);
  if (keyframes.empty())
    throw InputError(
        folder.string(), "a folder",
        "a file of poses, or the folder of a dump: of hdl_graph_slam with 000000/data, "
        "of GLIM with traj_lidar.txt");
  std::vector<StampedPose> stamped;
  for (const HdlKeyframe& keyframe : keyframes) stamped.push_back(keyframe.pose);
  const auto same =
      std::adjacent_find(stamped.begin(), stamped.end(),
                         [](const auto& a, const auto& b) { return a.stamp_ns == b.stamp_ns; });
  if (same != stamped.end())
    throw InputError(folder.string(), fmt::format("two key frames at {} ns", same->stamp_ns),
                     "one of each stamp: remove the other");
  poses.format = "hdl_graph_slam";
  poses.stamped = Trajectory(std::move(stamped));
  return poses;
}

}  // namespace

std::vector<Eigen::Isometry3d> PoseFile::all() const {
  if (!has_stamps()) return poses;
  std::vector<Eigen::Isometry3d> all;
  for (const StampedPose& pose : stamped.poses()) all.push_back(pose.T_map_lidar);
  return all;
}

PoseFile read_pose_file(const fs::path& file) {
  if (fs::is_directory(file)) return read_dump(file);
  PoseLines lines(file);
  lines.read(read_text(file));
  lines.require_some();
  PoseFile poses = lines.result();
  require_single_numbers(poses, file);
  return poses;
}

std::vector<Eigen::Isometry3d> read_kitti_poses(const fs::path& file) {
  return read_lines_of(file, "kitti", "12 numbers a line (KITTI)").poses;
}

Trajectory read_tum_trajectory(const fs::path& file) {
  return read_lines_of(file, "tum", "stamp tx ty tz qx qy qz qw a line (TUM)").stamped;
}

}  // namespace stillmap::maps
