#include "evaluation/odometry/table_pieces.hpp"

#include "evaluation/odometry/run_json.hpp"
#include "evaluation/paper/paper_pieces.hpp"

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <system_error>
#include <utility>

namespace stillmap::mapping {
namespace {

namespace fs = std::filesystem;

struct PaperSequence {
  const char* name;
  /// Without removal, and the paper's method [m].
  std::array<double, 2> printed_m;
};
constexpr std::array<PaperSequence, 4> kPaperSequences{
    {{"00", {1.60, 2.68}}, {"05", {2.40, 2.48}}, {"07", {1.55, 1.52}}, {"08", {6.42, 5.97}}}};

/// For names of files.
std::string joined(std::string text) {
  std::replace(text.begin(), text.end(), ' ', '-');
  return text;
}

/// What of a sequence is not there; nothing when all of it is.
std::optional<std::string> lack_of(const fs::path& kitti, const std::string& sequence) {
  const fs::path folder = kitti / "sequences" / sequence;
  if (!fs::is_directory(folder / "velodyne"))
    return fmt::format("no sequences/{}/velodyne", sequence);
  if (!fs::exists(folder / "calib.txt")) return fmt::format("no sequences/{}/calib.txt", sequence);
  if (!fs::exists(folder / "poses.txt") && !fs::exists(kitti / "poses" / (sequence + ".txt")))
    return fmt::format("no poses/{}.txt", sequence);
  return std::nullopt;
}

TableDrive kitti_drive(const fs::path& kitti, const std::string& sequence) {
  TableDrive drive{.name = "KITTI " + sequence, .folder = kitti / "sequences" / sequence};
  drive.key = key_of_drive(drive.folder);
  for (const PaperSequence& each : kPaperSequences) {
    if (sequence == each.name) drive.paper_m = each.printed_m;
  }
  return drive;
}

TableDrive simulated_street(const OdometryTableOptions& options, std::uint64_t seed,
                            const fs::path& work) {
  TableDrive drive{.name = fmt::format("seed {}", seed), .seed = seed};
  drive.key =
      key_of(fmt::format("{} street {} scans {} sensor {} parked {}", options.program, seed,
                         options.scans, options.sensor, options.parked_share.value_or(-1.0)));
  drive.folder = work / "drives" / fmt::format("{}-{}", joined(drive.name), drive.key);
  return drive;
}

}  // namespace

std::vector<TableDrive> kitti_drives(const OdometryTableOptions& options,
                                     std::vector<std::string>& missing) {
  constexpr const char* kLayout =
      "sequences/NN/velodyne/*.bin, sequences/NN/calib.txt and poses/NN.txt (or "
      "sequences/NN/poses.txt), as KITTI's odometry benchmark unpacks, NN of 00, 05, 07, 08 or as "
      "--sequences says";
  const fs::path& kitti = options.kitti.value();
  std::vector<TableDrive> drives;
  std::string first_lack;
  const auto add = [&](const std::string& sequence) {
    const auto lack = lack_of(kitti, sequence);
    if (!lack) drives.push_back(kitti_drive(kitti, sequence));
    if (lack && first_lack.empty()) first_lack = *lack;
    return !lack;
  };
  for (const std::string& sequence : options.sequences) {
    if (!add(sequence)) throw maps::InputError(kitti.string(), first_lack, kLayout);
  }
  if (!options.sequences.empty()) return drives;
  for (const PaperSequence& sequence : kPaperSequences) {
    if (!add(sequence.name)) missing.emplace_back(sequence.name);
  }
  if (drives.empty()) throw maps::InputError(kitti.string(), first_lack, kLayout);
  return drives;
}

std::vector<TableDrive> table_drives(const OdometryTableOptions& options, const fs::path& work,
                                     std::vector<std::string>& missing) {
  std::vector<TableDrive> drives;
  if (options.kitti) drives = kitti_drives(options, missing);
  for (std::size_t i = 0; i < options.drives.size(); ++i)
    drives.push_back({.name = fmt::format("drive {}", i + 1),
                      .folder = options.drives[i],
                      .key = key_of_drive(options.drives[i]),
                      .seed = std::nullopt,
                      .paper_m = std::nullopt});
  if (!drives.empty()) return drives;
  for (const std::uint64_t seed : options.seeds)
    drives.push_back(simulated_street(options, seed, work));
  return drives;
}

RunPiece run_piece(const OdometryTableOptions& options, const TableDrive& drive,
                   const std::string& method, MovablePolicy points, const fs::path& work) {
  // Without treatment it makes no difference what would have found the objects.
  const std::string detector = points == MovablePolicy::kKeep ? "" : options.detector;
  const std::string key = key_of(fmt::format("{} {} {} {} {}", options.program, drive.key, method,
                                             points_name(points), detector));
  return {
      .file = work / "odometry" /
              fmt::format("{}-{}-{}-{}.json", joined(drive.name), method, points_name(points), key),
      .key = key};
}

void write_run(const RunPiece& piece, const OdometryTableRun& run) {
  fs::path partial = piece.file;
  partial += ".partial";
  nlohmann::ordered_json json = run_json(run);
  json["key"] = piece.key;
  std::ofstream out(partial, std::ios::binary);
  out << json.dump() << '\n';
  out.close();
  if (!out) throw maps::StorageError(partial.string(), "cannot be written");
  std::error_code error;
  fs::rename(partial, piece.file, error);
  if (error) throw maps::StorageError(piece.file.string(), error.message());
}

std::optional<OdometryTableRun> read_run(const RunPiece& piece) {
  std::ifstream in(piece.file, std::ios::binary);
  if (!in) return std::nullopt;
  try {
    const auto json = nlohmann::ordered_json::parse(in);
    if (json.at("key") != piece.key) return std::nullopt;
    return run_of(json);
  } catch (const nlohmann::json::exception&) {
    return std::nullopt;
  }
}

}  // namespace stillmap::mapping
