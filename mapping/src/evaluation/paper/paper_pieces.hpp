#pragma once

#include "evaluation/paper/paper_maps.hpp"

#include <stillmap/mapping/paper_evaluation.hpp>
#include <stillmap/maps/map_package.hpp>

#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::mapping {

/// Two days of one street.
struct PaperStreet {
  std::string name;
  /// None where drives were given.
  std::optional<std::uint64_t> seed;
  /// Day 1 and day 2, and what they are known by.
  std::array<std::filesystem::path, 2> drives;
  std::array<std::string, 2> keys;
};

/// One question to all scans of a day 2.
struct PaperQuestion {
  std::string method;
  /// Whether movable objects are deleted from the scans.
  bool removed = false;
  /// `raw` or `removed`.
  [[nodiscard]] std::string query() const { return removed ? "removed" : "raw"; }
};

/// All of a table, in its order.
[[nodiscard]] std::vector<PaperQuestion> questions_of(const PaperEvaluationOptions& options);

/// A short checksum for names (64 bits, not against forgers).
/// @see Fowler, Noll, Vo, "The FNV non-cryptographic hash algorithm", FNV-1a.
[[nodiscard]] std::string key_of(std::string_view text);

/// What a given drive is known by: names, sizes and dates of its files, and its poses; reading all
/// of it would take as long as a map. @throws maps::InputError when it cannot be opened.
[[nodiscard]] std::string key_of_drive(const std::filesystem::path& folder);

/// Where the pieces of a table lie in a folder, and what they are called: a name for people and a
/// key of everything they come from, so that no piece is taken for another.
class PaperPieces {
 public:
  PaperPieces(const PaperEvaluationOptions& options, std::filesystem::path work);

  /// @throws maps::InputError for a given drive that cannot be opened.
  [[nodiscard]] std::vector<PaperStreet> streets() const;
  /// As `make_detector` takes it, for one drive.
  [[nodiscard]] std::string detector(const std::filesystem::path& drive) const;
  /// The map as it is built, and as it is asked in: another one when it is made plain.
  [[nodiscard]] std::filesystem::path built(const PaperStreet& street, const PaperMap& map) const;
  [[nodiscard]] std::filesystem::path asked(const PaperStreet& street, const PaperMap& map) const;
  [[nodiscard]] std::filesystem::path answers(const PaperStreet& street, const PaperMap& map,
                                              const PaperQuestion& question) const;
  [[nodiscard]] std::string answers_key(const PaperStreet& street, const PaperMap& map,
                                        const PaperQuestion& question) const;

 private:
  [[nodiscard]] std::string map_key(const PaperStreet& street, const PaperMap& map) const;

  const PaperEvaluationOptions& options_;
  std::filesystem::path work_;
};

/// @return nothing when there is no such folder; a broken one is removed first.
[[nodiscard]] std::shared_ptr<const maps::MapPackage> whole_map(const std::filesystem::path& map);
/// The same of a simulated drive. @param scans  that it must have.
[[nodiscard]] bool is_whole_drive(const std::filesystem::path& drive, std::size_t scans);

}  // namespace stillmap::mapping
