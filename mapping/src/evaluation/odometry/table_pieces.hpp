#pragma once

#include <stillmap/mapping/odometry_table.hpp>

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// A drive of the table, and where it lies.
struct TableDrive {
  std::string name;
  std::filesystem::path folder = {};
  /// What it is known by.
  std::string key = {};
  /// None where it was given.
  std::optional<std::uint64_t> seed = std::nullopt;
  std::optional<std::array<double, 2>> paper_m = std::nullopt;
};

/// The paper's sequences that `folder` holds, or those asked for.
/// @param missing  the paper's that are not there are added to it.
/// @throws maps::InputError naming the layout that is expected when a sequence that was asked for,
/// or all of the paper's, are not there.
[[nodiscard]] std::vector<TableDrive> kitti_drives(const OdometryTableOptions& options,
                                                   std::vector<std::string>& missing);

/// All drives of the table.
/// @throws as `kitti_drives`; maps::InputError for a given drive that cannot be opened.
[[nodiscard]] std::vector<TableDrive> table_drives(const OdometryTableOptions& options,
                                                   const std::filesystem::path& work,
                                                   std::vector<std::string>& missing);

/// Where a run lies, and the checksum of everything that it comes from.
struct RunPiece {
  std::filesystem::path file;
  std::string key;
};
[[nodiscard]] RunPiece run_piece(const OdometryTableOptions& options, const TableDrive& drive,
                                 const std::string& method, MovablePolicy points,
                                 const std::filesystem::path& work);

/// Keeps a run in a file, in one step. @throws maps::StorageError.
void write_run(const RunPiece& piece, const OdometryTableRun& run);
/// @return nothing when the file is not there, is broken, or was written with another key.
[[nodiscard]] std::optional<OdometryTableRun> read_run(const RunPiece& piece);

}  // namespace stillmap::mapping
