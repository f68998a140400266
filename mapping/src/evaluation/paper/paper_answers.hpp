#pragma once

#include <stillmap/mapping/localization_evaluation.hpp>
#include <stillmap/mapping/paper_evaluation.hpp>

#include <filesystem>
#include <optional>
#include <string>

namespace stillmap::mapping {

/// What of an evaluation enters the table. @param evaluation  with one level.
[[nodiscard]] PaperAnswers paper_answers(const LocalizationEvaluation& evaluation,
                                         const maps::MapPackage& map);

/// Keeps answers in a file, in one step. @param key  read back with them.
/// @throws maps::StorageError.
void write_answers(const std::filesystem::path& file, const std::string& key,
                   const PaperAnswers& answers);

/// @return nothing when the file is not there, is broken, or was written with another key.
[[nodiscard]] std::optional<PaperAnswers> read_answers(const std::filesystem::path& file,
                                                       const std::string& key);

}  // namespace stillmap::mapping
