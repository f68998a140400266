#pragma once

#include <stillmap/mapping/progress.hpp>

#include <CLI/CLI.hpp>

#include "command_line/text_file.hpp"

namespace stillmap::mapper {

/// Each adds one subcommand, with its options, help and callback.
void add_build(CLI::App& app);
void add_rebuild(CLI::App& app);
void add_import(CLI::App& app);
void add_export(CLI::App& app);
void add_simulate(CLI::App& app);
/// `evaluate` with its own subcommands.
void add_evaluate(CLI::App& app);
void add_evaluate_localization(CLI::App& evaluate);
void add_evaluate_map(CLI::App& evaluate);
void add_evaluate_detector(CLI::App& evaluate);
void add_evaluate_odometry(CLI::App& evaluate);
void add_evaluate_paper(CLI::App& evaluate);
void add_evaluate_paper_odometry(CLI::App& evaluate);

using command_line::write_text_file;

}  // namespace stillmap::mapper
