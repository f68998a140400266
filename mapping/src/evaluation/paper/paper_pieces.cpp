#include "evaluation/paper/paper_pieces.hpp"

#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <chrono>
#include <utility>

namespace stillmap::mapping {
namespace {

constexpr std::string_view kTrueBoxes = "boxes";
constexpr const char* kBoxesFile = "boxes.json";

PaperStreet given_street(std::size_t number, const std::array<std::filesystem::path, 2>& drives) {
  return {.name = fmt::format("drive {}", number),
          .seed = std::nullopt,
          .drives = drives,
          .keys = {key_of_drive(drives[0]), key_of_drive(drives[1])}};
}

/// For names of files.
std::string joined(std::string text) {
  for (char& letter : text) {
    if (letter == ' ') letter = '-';
  }
  return text;
}

}  // namespace

std::string key_of(std::string_view text) {
  std::uint64_t hash = 0xCBF29CE484222325ULL;
  for (const char letter : text) {
    hash ^= static_cast<unsigned char>(letter);
    hash *= 0x100000001B3ULL;
  }
  return fmt::format("{:016x}", hash);
}

std::string key_of_drive(const std::filesystem::path& folder) {
  const maps::Drive drive = maps::Drive::open(folder);
  std::string text = std::filesystem::weakly_canonical(folder).string();
  for (const std::filesystem::path& file : drive.contents().scan_files) {
    const auto written = std::filesystem::last_write_time(file).time_since_epoch();
    text += fmt::format("\n{} {} {}", file.filename().string(), std::filesystem::file_size(file),
                        std::chrono::nanoseconds(written).count());
  }
  for (std::size_t i = 0; drive.has_poses() && i < drive.size(); ++i) {
    const Eigen::Matrix4d T = drive.T_map_lidar(i).matrix();
    text.append(reinterpret_cast<const char*>(T.data()), sizeof(double) * 16);
  }
  return key_of(text);
}

std::vector<PaperQuestion> questions_of(const PaperEvaluationOptions& options) {
  std::vector<PaperQuestion> questions;
  for (const std::string& method : options.methods) {
    for (const bool removed : {false, true}) questions.push_back({method, removed});
  }
  return questions;
}

PaperPieces::PaperPieces(const PaperEvaluationOptions& options, std::filesystem::path work)
    : options_(options), work_(std::move(work)) {}

std::vector<PaperStreet> PaperPieces::streets() const {
  std::vector<PaperStreet> streets;
  for (std::size_t i = 0; i < options_.drives.size(); ++i)
    streets.push_back(given_street(i + 1, options_.drives[i]));
  if (!streets.empty()) return streets;
  for (const std::uint64_t seed : options_.seeds) {
    PaperStreet& street = streets.emplace_back();
    street.name = fmt::format("seed {}", seed);
    street.seed = seed;
    for (std::size_t day = 0; day < 2; ++day) {
      street.keys[day] = key_of(fmt::format("{} seed {} day {} scans {} sensor {} parked {}",
                                            options_.program, seed, day + 1, options_.scans,
                                            options_.sensor, options_.parked_share.value_or(-1.0)));
      street.drives[day] =
          work_ / "drives" /
          fmt::format("{}-day-{}-{}", joined(street.name), day + 1, street.keys[day]);
    }
  }
  return streets;
}

std::string PaperPieces::detector(const std::filesystem::path& drive) const {
  if (options_.detector != kTrueBoxes) return options_.detector;
  return "boxes:" + (drive / kBoxesFile).string();
}

std::string PaperPieces::map_key(const PaperStreet& street, const PaperMap& map) const {
  // Without a detector it makes no difference which one it would be.
  const bool detects = map.build.projection.policy != MovablePolicy::kKeep;
  return key_of(fmt::format("{} {} {} {}", options_.program, street.keys[0],
                            detects ? options_.detector : "", text_of(map.build)));
}

std::filesystem::path PaperPieces::built(const PaperStreet& street, const PaperMap& map) const {
  // `ours-all` is made of the same build as `ours`.
  const std::string base = map.name.substr(0, map.name.find("-all"));
  return work_ / "maps" / fmt::format("{}-{}-{}", joined(street.name), base, map_key(street, map));
}

std::filesystem::path PaperPieces::asked(const PaperStreet& street, const PaperMap& map) const {
  std::filesystem::path folder = built(street, map);
  if (map.plain) folder += "-plain";
  return folder;
}

std::string PaperPieces::answers_key(const PaperStreet& street, const PaperMap& map,
                                     const PaperQuestion& question) const {
  return key_of(fmt::format("{} {} {} {} {} {}", map_key(street, map), map.plain, street.keys[1],
                            question.method, question.query(),
                            question.removed ? options_.detector : ""));
}

std::filesystem::path PaperPieces::answers(const PaperStreet& street, const PaperMap& map,
                                           const PaperQuestion& question) const {
  return work_ / "answers" /
         fmt::format("{}-{}-{}-{}-{}.json", joined(street.name), map.name, question.method,
                     question.query(), answers_key(street, map, question));
}

std::shared_ptr<const maps::MapPackage> whole_map(const std::filesystem::path& map) {
  if (!std::filesystem::exists(map)) return nullptr;
  try {
    auto package = maps::MapPackage::open(map);
    if (package->verify().empty()) return package;
  } catch (const maps::InputError&) {
    // Broken, as below.
  }
  std::filesystem::remove_all(map);
  return nullptr;
}

bool is_whole_drive(const std::filesystem::path& drive, std::size_t scans) {
  if (!std::filesystem::exists(drive)) return false;
  try {
    const maps::Drive opened = maps::Drive::open(drive);
    if (opened.size() == scans && opened.has_poses() && std::filesystem::exists(drive / kBoxesFile))
      return true;
  } catch (const maps::InputError&) {
    // Broken, as below.
  }
  std::filesystem::remove_all(drive);
  return false;
}

}  // namespace stillmap::mapping
