#include "formats/hdl_keyframe.hpp"

#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <string>
#include <system_error>

#include <stillmap/maps/text.hpp>
#include "formats/pose_line.hpp"

namespace stillmap::maps {
namespace {

namespace fs = std::filesystem;

/// Behind the word `estimate`: a row a line.
Eigen::Isometry3d read_estimate(const fs::path& file, std::string_view& rest, std::size_t& number) {
  std::array<double, 16> n{};
  std::size_t filled = 0;
  const std::size_t first = number + 1;
  while (filled < n.size()) {
    const auto line = take_line(rest);
    if (!line)
      throw InputError(file.string(), "an estimate that is cut off",
                       "four rows of four numbers behind the word estimate: dump the graph again");
    ++number;
    const NumberLine row{number, split_fields(*line, 5)};
    parse_finite(file, row, std::span(n).subspan(filled, 4));
    filled += 4;
  }
  return pose_of_matrix(file, first, std::span(n).first<12>());
}

std::optional<std::int64_t> stamp_in(std::span<const std::string_view> fields) {
  if (fields.size() < 3) return std::nullopt;
  const auto seconds = parse_count(fields[1]);
  const auto nanoseconds = parse_count(fields[2]);
  constexpr std::uint64_t kMostSeconds = 9'000'000'000;
  if (!seconds || !nanoseconds || *seconds > kMostSeconds || *nanoseconds > 999'999'999)
    return std::nullopt;
  return static_cast<std::int64_t>(*seconds * 1'000'000'000 + *nanoseconds);
}

}  // namespace

std::vector<fs::path> hdl_keyframe_folders(const fs::path& root) {
  std::vector<fs::path> folders;
  std::error_code error;
  if (!fs::is_directory(root, error)) return folders;
  for (fs::directory_iterator entry(root, error), end; !error && entry != end;
       entry.increment(error)) {
    const std::string name = entry->path().filename().string();
    const bool is_number = name.find_first_not_of("0123456789") == std::string::npos;
    if (is_number && fs::exists(entry->path() / "cloud.pcd") && fs::exists(entry->path() / "data"))
      folders.push_back(entry->path());
  }
  if (error) throw StorageError(root.string(), error.message());
  std::sort(folders.begin(), folders.end(), [](const fs::path& a, const fs::path& b) {
    const std::string left = a.filename().string(), right = b.filename().string();
    return left.size() != right.size() ? left.size() < right.size() : left < right;
  });
  return folders;
}

std::vector<HdlKeyframe> read_hdl_keyframes(const fs::path& root) {
  std::vector<HdlKeyframe> keyframes;
  for (const fs::path& folder : hdl_keyframe_folders(root))
    keyframes.push_back({read_hdl_keyframe(folder / "data"), folder});
  std::stable_sort(keyframes.begin(), keyframes.end(),
                   [](const auto& a, const auto& b) { return a.pose.stamp_ns < b.pose.stamp_ns; });
  return keyframes;
}

StampedPose read_hdl_keyframe(const fs::path& file) {
  constexpr std::uintmax_t kMostBytes = std::uintmax_t{1} << 20U;
  const std::string text = read_text(file, kMostBytes);
  std::string_view rest = text;
  std::optional<std::int64_t> stamp_ns;
  std::optional<Eigen::Isometry3d> estimate;
  std::size_t number = 0;
  while (const auto line = take_line(rest)) {
    ++number;
    const std::vector<std::string_view> fields = split_fields(*line, 4);
    if (fields.empty()) continue;
    if (fields[0] == "stamp") {
      stamp_ns = stamp_in(fields);
      if (!stamp_ns)
        throw InputError(place(file, number), quoted(*line),
                         "stamp SECONDS NANOSECONDS: correct the line");
    }
    if (fields[0] == "estimate") estimate = read_estimate(file, rest, number);
  }
  if (!stamp_ns || !estimate)
    throw InputError(file.string(), stamp_ns ? "no estimate" : "no stamp",
                     "the stamp and estimate of a key frame: dump the graph again");
  return {*stamp_ns, *estimate};
}

}  // namespace stillmap::maps
