#include "drives/bag_files.hpp"

#include <stillmap/maps/error.hpp>

#include <array>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>

#include <stillmap/maps/text.hpp>
#include "drives/layout.hpp"

namespace stillmap::maps {
namespace {

namespace fs = std::filesystem;

constexpr const char* kMetadata = "metadata.yaml";
constexpr std::array<std::string_view, 5> kExtensions{".mcap", ".db3", ".bag", ".pcap", ".pcapng"};
constexpr std::string_view kPacked = ".zstd";

std::string_view without_blanks(std::string_view text) {
  const std::size_t begin = text.find_first_not_of(" \t\r");
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(" \t\r") + 1 - begin);
}

/// The list `relative_file_paths:` of a block of YAML, as rosbag2 writes it; no other YAML is read.
std::vector<std::string> listed_files(const fs::path& metadata) {
  const std::string text = read_text(metadata);
  std::string_view rest = text;
  std::vector<std::string> files;
  bool in_list = false;
  while (const auto line = take_line(rest)) {
    std::string_view item = without_blanks(*line);
    if (!in_list || !item.starts_with("- ")) {
      in_list = item == "relative_file_paths:";
      continue;
    }
    item = without_blanks(item.substr(2));
    if (item.size() >= 2 && (item.front() == '"' || item.front() == '\'') &&
        item.back() == item.front())
      item = item.substr(1, item.size() - 2);
    // Early versions name the folder too.
    files.push_back(fs::path(item).filename().string());
  }
  return files;
}

fs::path existing(const fs::path& folder, const std::string& file) {
  // A name may be too long for the disk; then there is no such file either.
  std::error_code error;
  // Unpacked by hand.
  if (file.ends_with(kPacked)) {
    fs::path unpacked_file = folder / file.substr(0, file.size() - kPacked.size());
    if (fs::is_regular_file(unpacked_file, error)) return unpacked_file;
  }
  fs::path path = folder / file;
  if (fs::is_regular_file(path, error)) return path;
  throw InputError((folder / kMetadata).string(), "'" + file + "', which is not there",
                   "the files of the whole bag: copy them all into this folder");
}

/// `*.zstd` and `*.zst` of an extension, those left out that lie beside their unpacked file.
std::vector<fs::path> packed_files(const fs::path& folder, std::string_view extension) {
  std::vector<fs::path> files;
  std::error_code error;
  for (const std::string_view packed : {kPacked, std::string_view(".zst")})
    for (fs::path& file : list_files(folder, packed))
      if (file.stem().extension() == extension && !fs::exists(folder / file.stem(), error))
        files.push_back(std::move(file));
  return files;
}

/// Of an extension, packed as a whole or not.
std::vector<fs::path> files_of_kind(const fs::path& folder, std::string_view extension) {
  std::vector<fs::path> files = list_files(folder, extension);
  std::vector<fs::path> packed = packed_files(folder, extension);
  if (!files.empty() && !packed.empty())
    throw InputError(
        folder.string(),
        files.front().filename().string() + " and " + packed.front().filename().string(),
        "all of them packed or none, or rosbag2's metadata.yaml that names them: move the others "
        "away");
  return files.empty() ? packed : files;
}

}  // namespace

bool holds_bag_files(const fs::path& folder) {
  for (const std::string_view extension : kExtensions)
    if (!list_files(folder, extension).empty() || !packed_files(folder, extension).empty())
      return true;
  return fs::is_regular_file(folder / kMetadata) && !listed_files(folder / kMetadata).empty();
}

std::vector<fs::path> bag_files(const fs::path& root) {
  if (!fs::is_directory(root)) return {root};
  std::vector<fs::path> files;
  if (fs::is_regular_file(root / kMetadata)) {
    for (const std::string& file : listed_files(root / kMetadata))
      files.push_back(existing(root, file));
    if (!files.empty()) return files;
  }
  for (const std::string_view extension : kExtensions) {
    std::vector<fs::path> of_kind = files_of_kind(root, extension);
    if (of_kind.empty()) continue;
    if (!files.empty())
      throw InputError(
          root.string(),
          files.front().filename().string() + " and " + of_kind.front().filename().string(),
          "files of one kind, or rosbag2's metadata.yaml that names them: move the others away");
    files = std::move(of_kind);
  }
  return files;
}

}  // namespace stillmap::maps
