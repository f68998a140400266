#pragma once

#include <stillmap/mapping/progress.hpp>

#include <CLI/CLI.hpp>

#include <filesystem>
#include <string>

namespace stillmap::mapper {

/// Each adds one subcommand, with its options, help and callback.
void add_build(CLI::App& app);
void add_simulate(CLI::App& app);
/// `evaluate` with its own subcommands.
void add_evaluate(CLI::App& app);
void add_evaluate_localization(CLI::App& evaluate);
void add_evaluate_map(CLI::App& evaluate);

/// Replaces a file in one step, so that nobody reads half of it. @throws maps::StorageError.
void write_text_file(const std::filesystem::path& file, const std::string& text);

}  // namespace stillmap::mapper
