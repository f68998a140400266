#pragma once

#include <CLI/CLI.hpp>

namespace stillmap::evaluate {

/// Each adds one subcommand of `evaluate`, with its options, help and callback.
void add_localization(CLI::App& evaluate);
void add_map(CLI::App& evaluate);
void add_detector(CLI::App& evaluate);
void add_odometry(CLI::App& evaluate);
void add_paper(CLI::App& evaluate);
void add_paper_odometry(CLI::App& evaluate);

}  // namespace stillmap::evaluate
