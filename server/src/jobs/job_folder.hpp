#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

namespace stillmap::server {

/// Where a job works. The log stays until the job is forgotten; the rest goes when it has ended.
/// What a power cut takes of the work is made again; uploads beside these folders last.
struct JobFolder {
  std::filesystem::path root;

  [[nodiscard]] std::filesystem::path log() const { return root / "log"; }
  /// Of a job that an older program did.
  [[nodiscard]] std::filesystem::path outcome() const { return root / "outcome.json"; }
  /// All else.
  [[nodiscard]] std::filesystem::path scratch() const { return root / "scratch"; }
  /// The mapper's own, with its checkpoints.
  [[nodiscard]] std::filesystem::path work() const { return scratch() / "work"; }
  [[nodiscard]] std::filesystem::path map() const { return scratch() / "map"; }
  [[nodiscard]] std::filesystem::path report() const { return scratch() / "report.json"; }
  [[nodiscard]] std::filesystem::path gate() const { return scratch() / "gate.json"; }
  [[nodiscard]] std::filesystem::path edits() const { return scratch() / "edits.json"; }
  /// Digest of the version that was active when it began.
  [[nodiscard]] std::filesystem::path previous() const { return scratch() / "previous"; }
};

/// Replaces the file as a whole; once it returns, a power cut leaves the new one. @throws
/// maps::StorageError.
void write_small_file(const std::filesystem::path& file, const std::string& text);
/// The name in this folder of the server that works in it, or keeps drives beside it; empty when it
/// has none yet.
[[nodiscard]] std::string server_of(const std::filesystem::path& folder);
/// Makes the name when there is none. @throws maps::StorageError.
[[nodiscard]] std::string name_server_of(const std::filesystem::path& folder);
/// Makes the folder's names last. @throws maps::StorageError.
void sync_folder(const std::filesystem::path& folder);
/// Nothing when there is none, or it is larger than a megabyte.
[[nodiscard]] std::optional<std::string> read_small_file(const std::filesystem::path& file);
/// With all in it; what cannot be removed stays until it is tried again.
void clear_folder(const std::filesystem::path& folder);

}  // namespace stillmap::server
