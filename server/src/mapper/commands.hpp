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
/// Not for people, who call `inspect --motion`.
void add_check_poses(CLI::App& app);

using command_line::write_text_file;

}  // namespace stillmap::mapper
